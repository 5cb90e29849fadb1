//! Recording commands, running them in one submission, and timing their stages on the device.

use std::sync::Arc;

use ash::vk;
use bytemuck::Pod;

use super::{Buffer, ComputePipeline, Device, Layers, Layout, Named, RayPipeline};
use crate::error::GpuError;

/// Most stages that are timed in one submission.
const MAX_STAGES: u32 = 64;

/// Seconds a stage on the device, in order; a stage that ran several times has several entries.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timings(pub Vec<(&'static str, f64)>);

impl Timings {
    /// Seconds of all stages of a name; 0 if none ran.
    pub fn secs(&self, stage: &str) -> f64 {
        let of_stage = self.0.iter().filter(|(name, _)| *name == stage);
        of_stage.map(|(_, secs)| secs).sum()
    }

    /// Seconds that rays took: to find what is active, and to sample it.
    pub fn rays_secs(&self) -> f64 {
        self.secs("find") + self.secs("march")
    }

    /// Seconds of all stages.
    pub fn total_secs(&self) -> f64 {
        self.0.iter().map(|(_, secs)| secs).sum()
    }
}

/// What is needed to record and run: one command buffer, one fence, a clock.
pub(crate) struct Commands {
    device: Arc<Device>,
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
    fence: vk::Fence,
    queries: vk::QueryPool,
}

impl Commands {
    pub fn new(device: &Arc<Device>) -> Result<Self, GpuError> {
        let mut commands = Self {
            device: device.clone(),
            pool: vk::CommandPool::null(),
            buffer: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            queries: vk::QueryPool::null(),
        };
        let (raw, name) = (device.raw(), device.name());
        let create = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::TRANSIENT)
            .queue_family_index(device.info().queue_family);
        // SAFETY: the device has a queue of this family.
        commands.pool = unsafe { raw.create_command_pool(&create, None) }
            .named("making a command pool", name)?;
        let allocate = vk::CommandBufferAllocateInfo::default()
            .command_pool(commands.pool)
            .command_buffer_count(1);
        // SAFETY: the pool was just made.
        let made = unsafe { raw.allocate_command_buffers(&allocate) }
            .named("taking a command buffer", name)?;
        commands.buffer = made[0];
        // SAFETY: nothing to be kept.
        commands.fence =
            unsafe { raw.create_fence(&Default::default(), None) }.named("making a fence", name)?;
        let create = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(2 * MAX_STAGES);
        // SAFETY: the queue family has timestamps.
        commands.queries =
            unsafe { raw.create_query_pool(&create, None) }.named("making a clock", name)?;
        Ok(commands)
    }

    /// Records with `record`, runs it all in one submission and waits.
    pub fn run(
        &mut self,
        layout: &Layout,
        record: impl FnOnce(&mut Recorder<'_>) -> Result<(), GpuError>,
    ) -> Result<Timings, GpuError> {
        let device = self.device.clone();
        let (raw, name) = (device.raw(), device.name());
        let begin = vk::CommandBufferBeginInfo::default()
            .flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the last submission was waited for, so nothing of the pool or the queries is in
        // use.
        unsafe {
            raw.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty())
                .named("resetting commands", name)?;
            raw.reset_query_pool(self.queries, 0, 2 * MAX_STAGES);
            raw.begin_command_buffer(self.buffer, &begin)
                .named("recording", name)?;
        }
        let mut recorder = Recorder {
            commands: self,
            layout,
            stages: Vec::new(),
        };
        record(&mut recorder)?;
        let stages = recorder.stages;
        // SAFETY: recording has begun.
        unsafe { raw.end_command_buffer(self.buffer) }.named("recording", name)?;
        device.run(self.buffer, self.fence)?;
        self.timings(&stages)
    }

    fn timings(&self, stages: &[&'static str]) -> Result<Timings, GpuError> {
        let mut ticks = vec![0u64; 2 * stages.len()];
        if stages.is_empty() {
            return Ok(Timings::default());
        }
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: as many queries were written as are read.
        unsafe {
            self.device
                .raw()
                .get_query_pool_results(self.queries, 0, &mut ticks, flags)
        }
        .named("reading the clock", self.device.name())?;
        let tick_secs = 1e-9 * f64::from(self.device.info().tick_nanos);
        let secs = |pair: &[u64]| pair[1].saturating_sub(pair[0]) as f64 * tick_secs;
        let named = stages.iter().zip(ticks.chunks(2));
        Ok(Timings(named.map(|(s, pair)| (*s, secs(pair))).collect()))
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        let raw = self.device.raw();
        // SAFETY: submissions are waited for, so nothing uses these; null handles are allowed.
        unsafe {
            raw.destroy_query_pool(self.queries, None);
            raw.destroy_fence(self.fence, None);
            raw.destroy_command_pool(self.pool, None);
        }
    }
}

/// Commands being recorded. Every stage waits for the one before.
pub(crate) struct Recorder<'a> {
    commands: &'a Commands,
    layout: &'a Layout,
    stages: Vec<&'static str>,
}

impl Recorder<'_> {
    /// What is being recorded into.
    pub(super) fn raw_commands(&self) -> vk::CommandBuffer {
        self.commands.buffer
    }

    fn raw(&self) -> &ash::Device {
        self.commands.device.raw()
    }

    /// Records a stage and times it; what it wrote is seen by all that follows.
    pub fn stage(&mut self, name: &'static str, record: impl FnOnce(&Self)) {
        let index = self.stages.len() as u32;
        let timed = index < MAX_STAGES;
        let stamp = |query| {
            if timed {
                let stage = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
                // SAFETY: the query was reset before recording and is written once.
                unsafe {
                    self.raw().cmd_write_timestamp(
                        self.commands.buffer,
                        stage,
                        self.commands.queries,
                        query,
                    );
                }
            }
        };
        stamp(2 * index);
        record(self);
        self.barrier();
        stamp(2 * index + 1);
        if timed {
            self.stages.push(name);
        }
    }

    /// Everything before is done and seen by everything after, and by the host.
    pub fn barrier(&self) {
        let access = vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE;
        let barrier = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
            .dst_access_mask(access | vk::AccessFlags::HOST_READ)];
        let from = self.commands.device.pipeline_stages() | vk::PipelineStageFlags::TRANSFER;
        // SAFETY: recording has begun.
        unsafe {
            self.raw().cmd_pipeline_barrier(
                self.commands.buffer,
                from,
                from | vk::PipelineStageFlags::HOST,
                vk::DependencyFlags::empty(),
                &barrier,
                &[],
                &[],
            );
        }
    }

    /// Runs a shader over workgroups.
    pub fn dispatch(&self, pipeline: &ComputePipeline, push: &impl Pod, groups: [u32; 3]) {
        let (raw, buffer, layout) = (self.raw(), self.commands.buffer, self.layout.raw());
        let point = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: pipeline and set have this layout; `push` fits into its push constants;
        // workgroup counts are below 65536, which every device allows.
        unsafe {
            raw.cmd_bind_pipeline(buffer, point, pipeline.raw());
            raw.cmd_bind_descriptor_sets(buffer, point, layout, 0, &[self.layout.set()], &[]);
            let stages = self.commands.device.shader_stages();
            raw.cmd_push_constants(buffer, layout, stages, 0, bytemuck::bytes_of(push));
            raw.cmd_dispatch(buffer, groups[0], groups[1], groups[2]);
        }
    }

    /// Runs the ray generation shader of a pipeline, an invocation each of width and height.
    pub fn trace(&self, pipeline: &RayPipeline, push: &impl Pod, [width, height]: [u32; 2]) {
        let Some(functions) = self.commands.device.ray_functions() else {
            return;
        };
        let Some(functions) = &functions.pipelines else {
            return;
        };
        let (raw, buffer, layout) = (self.raw(), self.commands.buffer, self.layout.raw());
        let point = vk::PipelineBindPoint::RAY_TRACING_KHR;
        let [generation, miss, hit] = pipeline.tables();
        let none = vk::StridedDeviceAddressRegionKHR::default();
        // SAFETY: pipeline and set have this layout, the set an acceleration structure that is
        // built; `push` fits into its push constants; the tables hold the pipeline's own groups.
        unsafe {
            raw.cmd_bind_pipeline(buffer, point, pipeline.raw());
            raw.cmd_bind_descriptor_sets(buffer, point, layout, 0, &[self.layout.set()], &[]);
            let stages = self.commands.device.shader_stages();
            raw.cmd_push_constants(buffer, layout, stages, 0, bytemuck::bytes_of(push));
            functions.cmd_trace_rays(buffer, generation, miss, hit, &none, width, height, 1);
        }
    }

    /// Writes up to 64 KiB, a multiple of 4 bytes, into a buffer.
    pub fn write(&self, to: &Buffer, bytes: &[u8]) {
        debug_assert!(bytes.len() <= 1 << 16 && bytes.len() as u64 <= to.size_bytes());
        // SAFETY: the bytes fit; they are copied into the command buffer.
        unsafe {
            self.raw()
                .cmd_update_buffer(self.commands.buffer, to.raw(), 0, bytes);
        }
    }

    /// Clears a buffer to zeros.
    pub fn clear(&self, buffer: &Buffer) {
        // SAFETY: the whole of a buffer that is alive.
        unsafe {
            self.raw()
                .cmd_fill_buffer(self.commands.buffer, buffer.raw(), 0, vk::WHOLE_SIZE, 0);
        }
    }

    /// Clears one word of a buffer to zero.
    pub fn clear_word(&self, buffer: &Buffer, index: u64) {
        debug_assert!(4 * (index + 1) <= buffer.size_bytes());
        // SAFETY: a word of a buffer that is alive.
        unsafe {
            let (to, place) = (buffer.raw(), 4 * index);
            self.raw()
                .cmd_fill_buffer(self.commands.buffer, to, place, 4, 0);
        }
    }

    /// Copies the first bytes of one buffer to a place in another.
    pub fn copy(&self, from: &Buffer, to: &Buffer, to_offset: u64, bytes: u64) {
        self.copy_between((from, 0), (to, to_offset), bytes);
    }

    /// Copies bytes from a place in one buffer to a place in another.
    pub fn copy_between(
        &self,
        (from, from_offset): (&Buffer, u64),
        (to, to_offset): (&Buffer, u64),
        bytes: u64,
    ) {
        debug_assert!(from_offset + bytes <= from.size_bytes());
        debug_assert!(to_offset + bytes <= to.size_bytes());
        let region = [vk::BufferCopy::default()
            .src_offset(from_offset)
            .dst_offset(to_offset)
            .size(bytes)];
        // SAFETY: the region lies within both.
        unsafe {
            self.raw()
                .cmd_copy_buffer(self.commands.buffer, from.raw(), to.raw(), &region);
        }
    }

    /// Moves an image from one use to another.
    pub fn transition(&self, image: &Layers, from: vk::ImageLayout, to: vk::ImageLayout) {
        let access = vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE;
        let barrier = [vk::ImageMemoryBarrier::default()
            .src_access_mask(access)
            .dst_access_mask(access)
            .old_layout(from)
            .new_layout(to)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image.raw())
            .subresource_range(image.all())];
        let all = vk::PipelineStageFlags::ALL_COMMANDS;
        // SAFETY: the image is alive and in the layout `from`.
        unsafe {
            self.raw().cmd_pipeline_barrier(
                self.commands.buffer,
                all,
                all,
                vk::DependencyFlags::empty(),
                &[],
                &[],
                &barrier,
            );
        }
    }

    /// Copies rows of voxels from a buffer into layers of an image.
    pub fn fill(&self, from: &Buffer, image: &Layers, regions: &[vk::BufferImageCopy]) {
        // SAFETY: callers keep regions within buffer and image.
        unsafe {
            self.raw().cmd_copy_buffer_to_image(
                self.commands.buffer,
                from.raw(),
                image.raw(),
                vk::ImageLayout::TRANSFER_DST_OPTIMAL,
                regions,
            );
        }
    }
}

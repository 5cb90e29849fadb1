//! Compute pipelines, and the one layout that they share: parameters, the volume's images, and a
//! block of push constants.

use std::sync::Arc;
use std::time::Instant;

use ash::vk;

use super::shader_cache::ShaderCache;
use super::{Buffer, Device, Layers, Named, Sampler};
use crate::error::GpuError;
use crate::shared::{MAX_SLABS, Push};

/// Where shaders find the acceleration structure, on devices that have them.
const SCENE_BINDING: u32 = 2;

/// A value that specialises a shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Constant {
    /// Its `constant_id`.
    pub id: u32,
    /// Its bits; booleans are 0 or 1.
    pub bits: u32,
}

/// What all pipelines are given: binding 0 the parameters, binding 1 the images,
/// and where there is ray tracing binding 2 the acceleration structure.
pub(crate) struct Layout {
    device: Arc<Device>,
    set_layout: vk::DescriptorSetLayout,
    pipeline_layout: vk::PipelineLayout,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    shaders: ShaderCache,
    sampler: Sampler,
}

impl Layout {
    pub fn new(device: &Arc<Device>) -> Result<Self, GpuError> {
        let sampler = Sampler::new(device)?;
        let mut layout = Self {
            device: device.clone(),
            set_layout: vk::DescriptorSetLayout::null(),
            pipeline_layout: vk::PipelineLayout::null(),
            pool: vk::DescriptorPool::null(),
            set: vk::DescriptorSet::null(),
            shaders: ShaderCache::new(device)?,
            sampler,
        };
        let raw = device.raw();
        let name = device.name();
        let stages = device.shader_stages();
        let has_scene = device.info().ray_tracing.is_some();
        let mut bindings = vec![
            vk::DescriptorSetLayoutBinding::default()
                .binding(0)
                .descriptor_type(vk::DescriptorType::UNIFORM_BUFFER)
                .descriptor_count(1)
                .stage_flags(stages),
            vk::DescriptorSetLayoutBinding::default()
                .binding(1)
                .descriptor_type(vk::DescriptorType::COMBINED_IMAGE_SAMPLER)
                .descriptor_count(MAX_SLABS as u32)
                .stage_flags(stages),
        ];
        if has_scene {
            let scene = vk::DescriptorSetLayoutBinding::default()
                .binding(SCENE_BINDING)
                .descriptor_type(vk::DescriptorType::ACCELERATION_STRUCTURE_KHR)
                .descriptor_count(1)
                .stage_flags(stages);
            bindings.push(scene);
        }
        let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: pointers in `create` outlive the call; likewise below.
        layout.set_layout = unsafe { raw.create_descriptor_set_layout(&create, None) }
            .named("making a descriptor layout", name)?;
        let sets = [layout.set_layout];
        let push = [vk::PushConstantRange::default()
            .stage_flags(stages)
            .size(size_of::<Push>() as u32)];
        let create = vk::PipelineLayoutCreateInfo::default()
            .set_layouts(&sets)
            .push_constant_ranges(&push);
        // SAFETY: the set layout is alive.
        layout.pipeline_layout = unsafe { raw.create_pipeline_layout(&create, None) }
            .named("making a pipeline layout", name)?;
        let mut sizes = vec![
            vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::UNIFORM_BUFFER)
                .descriptor_count(1),
            vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::COMBINED_IMAGE_SAMPLER)
                .descriptor_count(MAX_SLABS as u32),
        ];
        if has_scene {
            let scene = vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::ACCELERATION_STRUCTURE_KHR)
                .descriptor_count(1);
            sizes.push(scene);
        }
        let create = vk::DescriptorPoolCreateInfo::default()
            .max_sets(1)
            .pool_sizes(&sizes);
        // SAFETY: as above.
        layout.pool = unsafe { raw.create_descriptor_pool(&create, None) }
            .named("making a descriptor pool", name)?;
        let allocate = vk::DescriptorSetAllocateInfo::default()
            .descriptor_pool(layout.pool)
            .set_layouts(&sets);
        // SAFETY: the pool has room for one set of this layout.
        let found = unsafe { raw.allocate_descriptor_sets(&allocate) }
            .named("taking a descriptor set", name)?;
        layout.set = found[0];
        Ok(layout)
    }

    /// Points the bindings to parameters and images; where there are fewer images than places, the
    /// last one stands in.
    pub fn bind(&mut self, parameters: &Buffer, images: &[Layers]) {
        let buffer = [vk::DescriptorBufferInfo::default()
            .buffer(parameters.raw())
            .range(vk::WHOLE_SIZE)];
        let Some(last) = images.last() else { return };
        let places: Vec<vk::DescriptorImageInfo> = (0..MAX_SLABS)
            .map(|i| {
                vk::DescriptorImageInfo::default()
                    .sampler(self.sampler.raw())
                    .image_view(images.get(i).unwrap_or(last).view())
                    .image_layout(vk::ImageLayout::SHADER_READ_ONLY_OPTIMAL)
            })
            .collect();
        let writes = [
            vk::WriteDescriptorSet::default()
                .dst_set(self.set)
                .dst_binding(0)
                .descriptor_type(vk::DescriptorType::UNIFORM_BUFFER)
                .buffer_info(&buffer),
            vk::WriteDescriptorSet::default()
                .dst_set(self.set)
                .dst_binding(1)
                .descriptor_type(vk::DescriptorType::COMBINED_IMAGE_SAMPLER)
                .image_info(&places),
        ];
        // SAFETY: submissions are waited for, so the set is not in use; all objects are alive.
        unsafe { self.device.raw().update_descriptor_sets(&writes, &[]) }
    }

    /// Points binding 0 to parameters, for shaders without images.
    pub fn bind_parameters(&mut self, parameters: &Buffer) {
        let buffer = [vk::DescriptorBufferInfo::default()
            .buffer(parameters.raw())
            .range(vk::WHOLE_SIZE)];
        let writes = [vk::WriteDescriptorSet::default()
            .dst_set(self.set)
            .dst_binding(0)
            .descriptor_type(vk::DescriptorType::UNIFORM_BUFFER)
            .buffer_info(&buffer)];
        // SAFETY: as for `bind`.
        unsafe { self.device.raw().update_descriptor_sets(&writes, &[]) }
    }

    /// Points binding 2 to an acceleration structure.
    pub fn bind_scene(&mut self, scene: vk::AccelerationStructureKHR) {
        let scenes = [scene];
        let mut link = vk::WriteDescriptorSetAccelerationStructureKHR::default()
            .acceleration_structures(&scenes);
        let mut write = vk::WriteDescriptorSet::default()
            .dst_set(self.set)
            .dst_binding(SCENE_BINDING)
            .descriptor_type(vk::DescriptorType::ACCELERATION_STRUCTURE_KHR)
            .push_next(&mut link);
        write.descriptor_count = 1;
        // SAFETY: submissions are waited for, so the set is not in use; it has this binding on
        // every device that can make acceleration structures.
        unsafe { self.device.raw().update_descriptor_sets(&[write], &[]) }
    }

    pub fn raw(&self) -> vk::PipelineLayout {
        self.pipeline_layout
    }

    pub(super) fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Shaders compiled so far.
    pub fn shaders(&self) -> &ShaderCache {
        &self.shaders
    }

    /// Shaders compiled so far, to be added to.
    pub fn shaders_mut(&mut self) -> &mut ShaderCache {
        &mut self.shaders
    }

    pub fn set(&self) -> vk::DescriptorSet {
        self.set
    }
}

impl Drop for Layout {
    fn drop(&mut self) {
        let raw = self.device.raw();
        // SAFETY: submissions are waited for, so nothing uses these; null handles are allowed.
        unsafe {
            raw.destroy_descriptor_pool(self.pool, None);
            raw.destroy_pipeline_layout(self.pipeline_layout, None);
            raw.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// A compiled shader, needed while pipelines are made.
pub(super) struct Module<'a> {
    device: &'a Device,
    raw: vk::ShaderModule,
}

impl<'a> Module<'a> {
    pub fn new(device: &'a Device, spirv: &[u32]) -> Result<Self, GpuError> {
        let create = vk::ShaderModuleCreateInfo::default().code(spirv);
        // SAFETY: the code is SPIR-V that glslang wrote.
        let raw = unsafe { device.raw().create_shader_module(&create, None) }
            .named("loading a shader", device.name())?;
        Ok(Self { device, raw })
    }

    pub fn raw(&self) -> vk::ShaderModule {
        self.raw
    }
}

impl Drop for Module<'_> {
    fn drop(&mut self) {
        // SAFETY: pipelines keep what they need of the module.
        unsafe { self.device.raw().destroy_shader_module(self.raw, None) }
    }
}

/// Values of constants, as pipelines are made with them.
pub(super) struct Special {
    entries: Vec<vk::SpecializationMapEntry>,
    bits: Vec<u32>,
}

impl Special {
    pub fn new(constants: &[Constant]) -> Self {
        let entry = |(i, constant): (usize, &Constant)| {
            vk::SpecializationMapEntry::default()
                .constant_id(constant.id)
                .offset(4 * i as u32)
                .size(4)
        };
        Self {
            entries: constants.iter().enumerate().map(entry).collect(),
            bits: constants.iter().map(|c| c.bits).collect(),
        }
    }

    pub fn info(&self) -> vk::SpecializationInfo<'_> {
        vk::SpecializationInfo::default()
            .map_entries(&self.entries)
            .data(bytemuck::cast_slice(&self.bits))
    }
}

/// A compute shader, specialised and ready.
pub(crate) struct ComputePipeline {
    device: Arc<Device>,
    raw: vk::Pipeline,
}

impl ComputePipeline {
    /// Compiles a shader. If it counts on subgroups of so many lanes, none of them missing, that is
    /// demanded; of devices that know no such demand it is taken for granted.
    pub fn new(
        layout: &Layout,
        spirv: &[u32],
        constants: &[Constant],
        lanes: Option<u32>,
    ) -> Result<Self, GpuError> {
        let device = &layout.device;
        let name = device.name();
        let module = Module::new(device, spirv)?;
        let special = Special::new(constants);
        let info = special.info();
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module.raw())
            .name(c"main")
            .specialization_info(&info);
        let mut required = vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default();
        let stage = match lanes.filter(|_| device.info().can_fill_subgroups) {
            Some(lanes) => {
                required = required.required_subgroup_size(lanes);
                stage
                    .flags(vk::PipelineShaderStageCreateFlags::REQUIRE_FULL_SUBGROUPS)
                    .push_next(&mut required)
            }
            None => stage,
        };
        let create = [vk::ComputePipelineCreateInfo::default()
            .stage(stage)
            .layout(layout.pipeline_layout)];
        let start = Instant::now();
        // SAFETY: everything that `create` points to is alive.
        let made = unsafe {
            device
                .raw()
                .create_compute_pipelines(layout.shaders.raw(), &create, None)
        };
        let made = made
            .map_err(|(_, result)| result)
            .named("compiling a shader", name)?;
        let secs = start.elapsed().as_secs_f64();
        tracing::debug!(words = spirv.len(), secs, "a shader, compiled or known");
        Ok(Self {
            device: device.clone(),
            raw: made[0],
        })
    }

    pub fn raw(&self) -> vk::Pipeline {
        self.raw
    }
}

impl Drop for ComputePipeline {
    fn drop(&mut self) {
        // SAFETY: submissions are waited for, so nothing uses the pipeline.
        unsafe { self.device.raw().destroy_pipeline(self.raw, None) }
    }
}

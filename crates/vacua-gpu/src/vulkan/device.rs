//! An open device: its queue and its memory.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;

use super::ray_tracing::{RayFeatures, RayFunctions};
use super::{DeviceInfo, Instance, Named};
use crate::error::GpuError;

/// An open device.
pub struct Device {
    info: DeviceInfo,
    raw: ash::Device,
    ray_functions: Option<RayFunctions>,
    queue: Mutex<vk::Queue>,
    memory: vk::PhysicalDeviceMemoryProperties,
    instance: Arc<Instance>,
}

impl fmt::Debug for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Device").field(&self.info.name).finish()
    }
}

impl Device {
    pub(super) fn open(instance: Arc<Instance>, info: DeviceInfo) -> Result<Arc<Self>, GpuError> {
        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(info.queue_family)
            .queue_priorities(&priorities)];
        let mut extensions = Vec::new();
        if info.has_budget {
            extensions.push(ash::ext::memory_budget::NAME.as_ptr());
        }
        let mut subgroup_features = vk::PhysicalDeviceSubgroupSizeControlFeatures::default()
            .subgroup_size_control(true)
            .compute_full_subgroups(true);
        let mut ray_features = RayFeatures::default();
        let mut create = vk::DeviceCreateInfo::default();
        if info.can_fill_subgroups {
            extensions.push(ash::ext::subgroup_size_control::NAME.as_ptr());
            create = create.push_next(&mut subgroup_features);
        }
        let create = match info.ray_tracing {
            Some(found) => ray_features.ask_for(found, &mut extensions, create),
            None => create,
        };
        let features = vk::PhysicalDeviceFeatures::default().shader_float64(true);
        let mut features_12 = vk::PhysicalDeviceVulkan12Features::default()
            .buffer_device_address(true)
            .host_query_reset(true)
            .shader_sampled_image_array_non_uniform_indexing(true);
        let create = create
            .queue_create_infos(&queues)
            .enabled_extension_names(&extensions)
            .enabled_features(&features)
            .push_next(&mut features_12);
        // SAFETY: the physical device belongs to the instance and has all that is asked for, as
        // `DeviceInfo::lacks` is empty; pointers in `create` outlive the call.
        let raw = unsafe { instance.raw().create_device(info.physical, &create, None) }
            .named("opening the device", &info.name)?;
        // SAFETY: one queue of this family was asked for.
        let queue = unsafe { raw.get_device_queue(info.queue_family, 0) };
        // SAFETY: the handle belongs to the instance.
        let memory = unsafe {
            instance
                .raw()
                .get_physical_device_memory_properties(info.physical)
        };
        let ray_functions = info
            .ray_tracing
            .map(|found| RayFunctions::new(instance.raw(), &raw, found));
        Ok(Arc::new(Self {
            info,
            raw,
            ray_functions,
            queue: Mutex::new(queue),
            memory,
            instance,
        }))
    }

    /// What the loader says about it.
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.info.name
    }

    /// Warnings and errors of the validation layer so far; `None` if it is off.
    pub fn complaints(&self) -> Option<usize> {
        self.instance.complaints()
    }

    pub(crate) fn raw(&self) -> &ash::Device {
        &self.raw
    }

    /// The functions of ray tracing, where it has any.
    pub(crate) fn ray_functions(&self) -> Option<&RayFunctions> {
        self.ray_functions.as_ref()
    }

    /// Uses of buffers that every buffer may be put to.
    pub(super) fn buffer_usage(&self) -> vk::BufferUsageFlags {
        let mut usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::UNIFORM_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST
            | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS;
        if let Some(found) = self.info.ray_tracing {
            usage |= found.buffer_usage();
        }
        usage
    }

    /// Stages of pipelines that run our shaders.
    pub(super) fn pipeline_stages(&self) -> vk::PipelineStageFlags {
        let mut stages = vk::PipelineStageFlags::COMPUTE_SHADER;
        if let Some(found) = self.info.ray_tracing {
            stages |= found.pipeline_stages();
        }
        stages
    }

    /// Shaders that see parameters, images and push constants.
    pub(super) fn shader_stages(&self) -> vk::ShaderStageFlags {
        let mut stages = vk::ShaderStageFlags::COMPUTE;
        if self.info.has_ray_tracing() {
            stages |= vk::ShaderStageFlags::RAYGEN_KHR | vk::ShaderStageFlags::INTERSECTION_KHR;
        }
        stages
    }

    /// Bytes of its own memory that are free, as far as the driver tells.
    pub fn free_bytes(&self) -> u64 {
        let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
        let mut properties = vk::PhysicalDeviceMemoryProperties2::default();
        if self.info.has_budget {
            properties = properties.push_next(&mut budget);
        }
        // SAFETY: the handle belongs to the instance; the chain lives through the call.
        unsafe {
            self.instance
                .raw()
                .get_physical_device_memory_properties2(self.info.physical, &mut properties);
        }
        let heaps = &self.memory.memory_heaps[..self.memory.memory_heap_count as usize];
        let local = heaps
            .iter()
            .enumerate()
            .filter(|(_, heap)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        let free = local.map(|(i, heap)| {
            if self.info.has_budget {
                budget.heap_budget[i].saturating_sub(budget.heap_usage[i])
            } else {
                heap.size
            }
        });
        free.max().unwrap_or(0)
    }

    /// Most layers and bytes of an image of a format that shaders fetch from; `None` if the device
    /// has no such images.
    pub(crate) fn image_limits(&self, format: vk::Format) -> Option<(u32, u64)> {
        // SAFETY: the handle belongs to the instance.
        let found = unsafe {
            self.instance
                .raw()
                .get_physical_device_image_format_properties(
                    self.info.physical,
                    format,
                    vk::ImageType::TYPE_2D,
                    vk::ImageTiling::OPTIMAL,
                    vk::ImageUsageFlags::SAMPLED | vk::ImageUsageFlags::TRANSFER_DST,
                    vk::ImageCreateFlags::empty(),
                )
        };
        found
            .ok()
            .map(|limits| (limits.max_array_layers, limits.max_resource_size))
    }

    /// Takes memory with all of `flags`, or with as many of the first as there are.
    pub(super) fn allocate(
        &self,
        what: &'static str,
        needs: vk::MemoryRequirements,
        wishes: &[vk::MemoryPropertyFlags],
        addressed: bool,
    ) -> Result<(vk::DeviceMemory, vk::MemoryPropertyFlags), GpuError> {
        let types = &self.memory.memory_types[..self.memory.memory_type_count as usize];
        let with = |flags: vk::MemoryPropertyFlags| {
            let fits = |(i, t): &(usize, &vk::MemoryType)| {
                needs.memory_type_bits >> i & 1 == 1 && t.property_flags.contains(flags)
            };
            types.iter().enumerate().find(fits)
        };
        let Some((index, found)) = wishes.iter().find_map(|&flags| with(flags)) else {
            return Err(vk::Result::ERROR_FEATURE_NOT_PRESENT)
                .named("finding memory of a kind", self.name());
        };
        let mut flags =
            vk::MemoryAllocateFlagsInfo::default().flags(vk::MemoryAllocateFlags::DEVICE_ADDRESS);
        let mut allocate = vk::MemoryAllocateInfo::default()
            .allocation_size(needs.size)
            .memory_type_index(index as u32);
        if addressed {
            allocate = allocate.push_next(&mut flags);
        }
        // SAFETY: size and type are those that the object asked for.
        match unsafe { self.raw.allocate_memory(&allocate, None) } {
            Ok(memory) => Ok((memory, found.property_flags)),
            Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY) => {
                Err(self.too_little(what, needs.size))
            }
            Err(other) => Err(other).named("taking memory", self.name()),
        }
    }

    /// The error for something that does not fit.
    pub(crate) fn too_little(&self, what: &'static str, needed: u64) -> GpuError {
        GpuError::Memory {
            what,
            device: self.name().to_owned(),
            needed,
            available: self.free_bytes().min(needed),
        }
    }

    /// Runs commands and waits for them.
    pub(super) fn run(
        &self,
        commands: vk::CommandBuffer,
        fence: vk::Fence,
    ) -> Result<(), GpuError> {
        let list = [commands];
        let submit = [vk::SubmitInfo::default().command_buffers(&list)];
        let queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: the commands are recorded and not running; the lock keeps the queue to us.
        unsafe { self.raw.queue_submit(*queue, &submit, fence) }
            .named("submitting work", self.name())?;
        drop(queue);
        // SAFETY: the fence belongs to this device.
        unsafe { self.raw.wait_for_fences(&[fence], true, u64::MAX) }
            .named("waiting for the device", self.name())?;
        // SAFETY: nothing waits for the fence any more.
        unsafe { self.raw.reset_fences(&[fence]) }.named("resetting a fence", self.name())
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: all objects hold an `Arc` of the device, so none is left; submissions are waited
        // for. The instance goes after.
        unsafe { self.raw.destroy_device(None) }
    }
}

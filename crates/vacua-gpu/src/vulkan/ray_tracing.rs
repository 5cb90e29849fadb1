//! What a device can do of ray tracing, and how it is asked for.

use std::ffi::c_char;

use ash::vk;

/// Ray tracing as far as a device has it: acceleration structures always, else there is none of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RayTracing {
    /// Whether there are ray tracing pipelines.
    pub has_pipelines: bool,
    /// Whether compute shaders may ask acceleration structures.
    pub has_queries: bool,
    /// Bytes of a handle of a group of shaders.
    pub handle_bytes: u64,
    /// What handles in a table are aligned to.
    pub handle_alignment: u64,
    /// What tables are aligned to.
    pub table_alignment: u64,
    /// What scratch memory of builds is aligned to.
    pub scratch_alignment: u64,
    /// Triangles or boxes that an acceleration structure may have.
    pub max_primitives: u64,
}

impl RayTracing {
    /// What a device has of it.
    pub fn describe(
        instance: &ash::Instance,
        physical: vk::PhysicalDevice,
        extensions: &[vk::ExtensionProperties],
    ) -> Option<Self> {
        let has = |name| {
            let mut names = extensions.iter().map(|e| e.extension_name_as_c_str());
            names.any(|found| found == Ok(name))
        };
        if !has(ash::khr::acceleration_structure::NAME)
            || !has(ash::khr::deferred_host_operations::NAME)
        {
            return None;
        }
        let mut structures = vk::PhysicalDeviceAccelerationStructureFeaturesKHR::default();
        let mut pipelines = vk::PhysicalDeviceRayTracingPipelineFeaturesKHR::default();
        let mut queries = vk::PhysicalDeviceRayQueryFeaturesKHR::default();
        let mut structure_limits = vk::PhysicalDeviceAccelerationStructurePropertiesKHR::default();
        let mut pipeline_limits = vk::PhysicalDeviceRayTracingPipelinePropertiesKHR::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut structures);
        let mut limits = vk::PhysicalDeviceProperties2::default().push_next(&mut structure_limits);
        if has(ash::khr::ray_tracing_pipeline::NAME) {
            features = features.push_next(&mut pipelines);
            limits = limits.push_next(&mut pipeline_limits);
        }
        if has(ash::khr::ray_query::NAME) {
            features = features.push_next(&mut queries);
        }
        // SAFETY: the handle comes from this instance, the chains live through the calls, and the
        // device knows the extensions that their structs belong to.
        unsafe {
            instance.get_physical_device_features2(physical, &mut features);
            instance.get_physical_device_properties2(physical, &mut limits);
        }
        let found = Self {
            has_pipelines: pipelines.ray_tracing_pipeline != 0,
            has_queries: queries.ray_query != 0,
            handle_bytes: pipeline_limits.shader_group_handle_size.into(),
            handle_alignment: pipeline_limits.shader_group_handle_alignment.into(),
            table_alignment: pipeline_limits.shader_group_base_alignment.into(),
            scratch_alignment: structure_limits
                .min_acceleration_structure_scratch_offset_alignment
                .max(1)
                .into(),
            max_primitives: structure_limits.max_primitive_count,
        };
        let is_useful =
            structures.acceleration_structure != 0 && (found.has_pipelines || found.has_queries);
        is_useful.then_some(found)
    }

    /// Uses of buffers that come with it.
    pub fn buffer_usage(self) -> vk::BufferUsageFlags {
        let mut usage = vk::BufferUsageFlags::ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_KHR
            | vk::BufferUsageFlags::ACCELERATION_STRUCTURE_STORAGE_KHR;
        if self.has_pipelines {
            usage |= vk::BufferUsageFlags::SHADER_BINDING_TABLE_KHR;
        }
        usage
    }

    /// Stages that come with it.
    pub fn pipeline_stages(self) -> vk::PipelineStageFlags {
        let mut stages = vk::PipelineStageFlags::ACCELERATION_STRUCTURE_BUILD_KHR;
        if self.has_pipelines {
            stages |= vk::PipelineStageFlags::RAY_TRACING_SHADER_KHR;
        }
        stages
    }
}

/// The structs by which a device is asked for ray tracing.
#[derive(Default)]
pub(super) struct RayFeatures<'a> {
    structures: vk::PhysicalDeviceAccelerationStructureFeaturesKHR<'a>,
    pipelines: vk::PhysicalDeviceRayTracingPipelineFeaturesKHR<'a>,
    queries: vk::PhysicalDeviceRayQueryFeaturesKHR<'a>,
}

impl<'a> RayFeatures<'a> {
    /// Adds extensions and features to what a device is made with.
    pub fn ask_for(
        &'a mut self,
        found: RayTracing,
        extensions: &mut Vec<*const c_char>,
        create: vk::DeviceCreateInfo<'a>,
    ) -> vk::DeviceCreateInfo<'a> {
        extensions.push(ash::khr::deferred_host_operations::NAME.as_ptr());
        extensions.push(ash::khr::acceleration_structure::NAME.as_ptr());
        self.structures.acceleration_structure = vk::TRUE;
        let mut create = create.push_next(&mut self.structures);
        if found.has_pipelines {
            extensions.push(ash::khr::ray_tracing_pipeline::NAME.as_ptr());
            self.pipelines.ray_tracing_pipeline = vk::TRUE;
            create = create.push_next(&mut self.pipelines);
        }
        if found.has_queries {
            extensions.push(ash::khr::ray_query::NAME.as_ptr());
            self.queries.ray_query = vk::TRUE;
            create = create.push_next(&mut self.queries);
        }
        create
    }
}

/// The functions of the extensions.
pub(crate) struct RayFunctions {
    pub structures: ash::khr::acceleration_structure::Device,
    pub pipelines: Option<ash::khr::ray_tracing_pipeline::Device>,
}

impl RayFunctions {
    pub(super) fn new(instance: &ash::Instance, device: &ash::Device, found: RayTracing) -> Self {
        let pipelines = found
            .has_pipelines
            .then(|| ash::khr::ray_tracing_pipeline::Device::new(instance, device));
        Self {
            structures: ash::khr::acceleration_structure::Device::new(instance, device),
            pipelines,
        }
    }
}

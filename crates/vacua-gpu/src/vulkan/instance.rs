//! The Vulkan loader, and which devices it has.

use std::ffi::{CStr, c_void};
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use ash::vk;

use super::ray_tracing::RayTracing;
use super::shader_cache::ShaderKind;
use super::{Device, Named};
use crate::error::GpuError;

/// The Vulkan version that is used.
const API_VERSION: u32 = vk::API_VERSION_1_2;

/// The layer that checks every call.
const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Which GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The best that is hardware; never a CPU that poses as a device.
    #[default]
    Hardware,
    /// The best there is, whatever it is.
    Any,
    /// One by its number in the loader's order.
    Number(usize),
    /// All that are hardware, or all there are if none is; where one is to be opened, the best.
    All,
}

impl FromStr for DeviceChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            None if text == "gpu" => Ok(Self::Any),
            Some(("gpu", "all")) => Ok(Self::All),
            Some(("gpu", number)) => number
                .parse()
                .map(Self::Number)
                .map_err(|_| format!("`{number}` is no number of a device")),
            _ => Err(format!(
                "`{text}` is no device, expected gpu, gpu:N or gpu:all"
            )),
        }
    }
}

/// What a device is, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A card of its own.
    Discrete,
    /// Part of the processor.
    Integrated,
    /// A part of a device, lent to a virtual machine.
    Virtual,
    /// Anything else.
    Other,
    /// A program that poses as a device.
    Cpu,
}

/// A device as the loader describes it.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Its number in the loader's order.
    pub number: usize,
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: DeviceKind,
    /// Bytes of its own memory.
    pub memory_bytes: u64,
    /// What it lacks to render; empty if nothing.
    pub lacks: Vec<&'static str>,
    pub(crate) physical: vk::PhysicalDevice,
    pub(crate) queue_family: u32,
    /// Nanoseconds a tick of its clock.
    pub(crate) tick_nanos: f32,
    pub(crate) max_side: u32,
    /// Bytes of shared memory, and invocations in full subgroups, that a workgroup may have.
    pub(crate) max_shared_bytes: u32,
    pub(crate) max_invocations: u32,
    pub(crate) max_allocation_bytes: u64,
    pub(crate) has_budget: bool,
    pub(crate) ray_tracing: Option<RayTracing>,
    /// Lanes of a subgroup, if they can vote, ballot, shuffle and find the least of all.
    pub(crate) subgroup_lanes: Option<u32>,
    /// Whether pipelines can demand that subgroups have as many lanes, and all of them are there.
    pub(crate) can_fill_subgroups: bool,
    /// What tells its compiled shaders from others'.
    pub(crate) shaders: ShaderKind,
}

impl DeviceInfo {
    /// A name of its model that is the same wherever there is one like it, of letters, digits and `-`.
    pub fn model(&self) -> String {
        self.shaders.model()
    }

    /// Whether it has acceleration structures and ray tracing pipelines.
    pub fn has_ray_tracing(&self) -> bool {
        self.ray_tracing.is_some_and(|r| r.has_pipelines)
    }

    /// Whether compute shaders may ask acceleration structures themselves.
    pub fn has_ray_queries(&self) -> bool {
        self.ray_tracing.is_some_and(|r| r.has_queries)
    }
}

impl fmt::Display for DeviceInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.number, self.name)?;
        if !self.lacks.is_empty() {
            write!(f, " (lacks {})", self.lacks.join(", "))?;
        }
        Ok(())
    }
}

/// The loader, ready to open devices.
pub struct Instance {
    entry: ash::Entry,
    raw: ash::Instance,
    validation: Option<Validation>,
}

struct Validation {
    functions: ash::ext::debug_utils::Instance,
    messenger: vk::DebugUtilsMessengerEXT,
    /// Complaints so far; the driver holds a pointer to it.
    complaints: Box<AtomicUsize>,
}

impl fmt::Debug for Instance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Instance")
            .field("validated", &self.validation.is_some())
            .finish_non_exhaustive()
    }
}

impl Instance {
    /// Loads Vulkan; `validate` has every call checked, which needs the Khronos validation layer.
    ///
    /// # Errors
    /// [`GpuError::NoLoader`], [`GpuError::OldLoader`], or what the driver says.
    pub fn new(validate: bool) -> Result<Arc<Self>, GpuError> {
        // SAFETY: loading a library runs its initialisers; the system's Vulkan loader is trusted.
        let entry =
            unsafe { ash::Entry::load() }.map_err(|source| GpuError::NoLoader { source })?;
        // SAFETY: no precondition.
        let version = unsafe { entry.try_enumerate_instance_version() }
            .named("asking for the version", "the Vulkan loader")?
            .unwrap_or(vk::API_VERSION_1_0);
        let (major, minor) = (
            vk::api_version_major(version),
            vk::api_version_minor(version),
        );
        if (major, minor) < (1, 2) {
            return Err(GpuError::OldLoader { major, minor });
        }
        let application = vk::ApplicationInfo::default()
            .application_name(c"vacua")
            .api_version(API_VERSION);
        let layers = [VALIDATION_LAYER.as_ptr()];
        let extensions = [ash::ext::debug_utils::NAME.as_ptr()];
        let mut create = vk::InstanceCreateInfo::default().application_info(&application);
        if validate {
            create = create
                .enabled_layer_names(&layers)
                .enabled_extension_names(&extensions);
        }
        // SAFETY: all pointers in `create` outlive the call.
        let raw = unsafe { entry.create_instance(&create, None) }
            .named("starting", "the Vulkan loader")?;
        let mut instance = Self {
            entry,
            raw,
            validation: None,
        };
        if validate {
            instance.validation = Some(instance.watch()?);
        }
        Ok(Arc::new(instance))
    }

    /// Counts and logs what the validation layer says.
    fn watch(&self) -> Result<Validation, GpuError> {
        let functions = ash::ext::debug_utils::Instance::new(&self.entry, &self.raw);
        let complaints = Box::new(AtomicUsize::new(0));
        let counter: *const AtomicUsize = &*complaints;
        let create = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING
                    | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(
                vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION
                    | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
            )
            .pfn_user_callback(Some(complaint))
            .user_data(counter.cast_mut().cast());
        // SAFETY: the counter is boxed and freed only after the messenger (see `drop`).
        let messenger = unsafe { functions.create_debug_utils_messenger(&create, None) }
            .named("listening to validation", "the Vulkan loader")?;
        Ok(Validation {
            functions,
            messenger,
            complaints,
        })
    }

    /// Warnings and errors of the validation layer so far; `None` if it is off.
    pub fn complaints(&self) -> Option<usize> {
        let validation = self.validation.as_ref()?;
        Some(validation.complaints.load(Ordering::Relaxed))
    }

    pub(crate) fn raw(&self) -> &ash::Instance {
        &self.raw
    }

    /// All devices, in the loader's order.
    ///
    /// # Errors
    /// What the driver says.
    pub fn devices(&self) -> Result<Vec<DeviceInfo>, GpuError> {
        // SAFETY: the instance is alive.
        let found = unsafe { self.raw.enumerate_physical_devices() }
            .named("listing devices", "the Vulkan loader")?;
        let described = found.into_iter().enumerate();
        Ok(described.map(|(n, d)| self.describe(n, d)).collect())
    }

    /// Opens a device.
    ///
    /// # Errors
    /// [`GpuError::NoDevice`], [`GpuError::NoSuchDevice`], [`GpuError::Lacking`], or what the
    /// driver says.
    pub fn open(self: &Arc<Self>, choice: DeviceChoice) -> Result<Arc<Device>, GpuError> {
        let devices = self.devices()?;
        let named = || devices.iter().map(ToString::to_string).collect();
        if let DeviceChoice::Number(asked) = choice {
            let Some(info) = devices.get(asked) else {
                return Err(GpuError::NoSuchDevice {
                    asked,
                    available: named(),
                });
            };
            if !info.lacks.is_empty() {
                return Err(GpuError::Lacking {
                    device: info.name.clone(),
                    missing: info.lacks.join(", "),
                });
            }
            return Device::open(self.clone(), info.clone());
        }
        let hardware_only = choice == DeviceChoice::Hardware;
        let best = devices
            .iter()
            .filter(|d| d.lacks.is_empty())
            .filter(|d| !(hardware_only && d.kind == DeviceKind::Cpu))
            .min_by_key(|d| (d.kind, u64::MAX - d.memory_bytes, d.number));
        match best {
            Some(info) => Device::open(self.clone(), info.clone()),
            None => Err(GpuError::NoDevice { refused: named() }),
        }
    }

    /// The devices of a choice, one by one: their numbers for [`DeviceChoice::All`], else the choice.
    ///
    /// # Errors
    /// [`GpuError::NoDevice`], or what the driver says.
    pub fn resolve(&self, choice: DeviceChoice) -> Result<Vec<DeviceChoice>, GpuError> {
        if choice != DeviceChoice::All {
            return Ok(vec![choice]);
        }
        let devices = self.devices()?;
        let usable: Vec<&DeviceInfo> = devices.iter().filter(|d| d.lacks.is_empty()).collect();
        let has_hardware = usable.iter().any(|d| d.kind != DeviceKind::Cpu);
        let chosen = usable
            .iter()
            .filter(|d| !(has_hardware && d.kind == DeviceKind::Cpu));
        let numbers: Vec<_> = chosen.map(|d| DeviceChoice::Number(d.number)).collect();
        if numbers.is_empty() {
            return Err(GpuError::NoDevice {
                refused: devices.iter().map(ToString::to_string).collect(),
            });
        }
        Ok(numbers)
    }

    fn describe(&self, number: usize, physical: vk::PhysicalDevice) -> DeviceInfo {
        let mut limits_11 = vk::PhysicalDeviceVulkan11Properties::default();
        let mut subgroup_limits = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut limits_11)
            .push_next(&mut subgroup_limits);
        let mut features_12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut subgroup_features = vk::PhysicalDeviceSubgroupSizeControlFeatures::default();
        let mut features = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut features_12)
            .push_next(&mut subgroup_features);
        // SAFETY: the handle comes from this instance; the chains live through the calls. Devices
        // that do not know a struct leave it as it is.
        let (memory, families, extensions) = unsafe {
            self.raw
                .get_physical_device_properties2(physical, &mut properties);
            self.raw
                .get_physical_device_features2(physical, &mut features);
            (
                self.raw.get_physical_device_memory_properties(physical),
                self.raw
                    .get_physical_device_queue_family_properties(physical),
                self.raw
                    .enumerate_device_extension_properties(physical)
                    .unwrap_or_default(),
            )
        };
        let base = properties.properties;
        let core = features.features;
        let family = families
            .iter()
            .enumerate()
            .filter(|(_, f)| f.queue_flags.contains(vk::QueueFlags::COMPUTE))
            .filter(|(_, f)| f.timestamp_valid_bits > 0)
            .min_by_key(|(_, f)| !f.queue_flags.contains(vk::QueueFlags::GRAPHICS));
        let needs = [
            (base.api_version >= API_VERSION, "Vulkan 1.2"),
            (family.is_some(), "a compute queue with a clock"),
            (features_12.buffer_device_address != 0, "buffer addresses"),
            (features_12.host_query_reset != 0, "host query reset"),
            (
                features_12.shader_sampled_image_array_non_uniform_indexing != 0,
                "arrays of images",
            ),
            (
                limits_11
                    .subgroup_supported_stages
                    .contains(vk::ShaderStageFlags::COMPUTE)
                    && limits_11
                        .subgroup_supported_operations
                        .contains(vk::SubgroupFeatureFlags::ARITHMETIC),
                "arithmetic in subgroups",
            ),
            (core.shader_float64 != 0, "64-bit floating point"),
            (
                base.limits.max_compute_work_group_invocations >= 256,
                "workgroups of 256",
            ),
        ];
        let memory_bytes = memory.memory_heaps[..memory.memory_heap_count as usize]
            .iter()
            .filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
            .map(|heap| heap.size)
            .max();
        let has = |name| {
            let mut names = extensions.iter().map(|e| e.extension_name_as_c_str());
            names.any(|found| found == Ok(name))
        };
        let mut max_invocations = base
            .limits
            .max_compute_work_group_invocations
            .min(base.limits.max_compute_work_group_size[0]);
        let full_invocations = limits_11
            .subgroup_size
            .saturating_mul(subgroup_limits.max_compute_workgroup_subgroups);
        let can_fill_subgroups = has(ash::ext::subgroup_size_control::NAME)
            && subgroup_features.subgroup_size_control != 0
            && subgroup_features.compute_full_subgroups != 0
            && subgroup_limits
                .required_subgroup_size_stages
                .contains(vk::ShaderStageFlags::COMPUTE);
        if can_fill_subgroups {
            max_invocations = max_invocations.min(full_invocations);
        }
        let ray_tracing = RayTracing::describe(&self.raw, physical, &extensions);
        DeviceInfo {
            number,
            ray_tracing,
            name: base
                .device_name_as_c_str()
                .map(|name| name.to_string_lossy().into_owned())
                .unwrap_or_default(),
            kind: match base.device_type {
                vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
                vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
                vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
                vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
                _ => DeviceKind::Other,
            },
            memory_bytes: memory_bytes.unwrap_or(0),
            lacks: needs
                .iter()
                .filter(|need| !need.0)
                .map(|need| need.1)
                .collect(),
            physical,
            queue_family: family.map_or(0, |(index, _)| index as u32),
            tick_nanos: base.limits.timestamp_period,
            max_side: base.limits.max_image_dimension2_d,
            max_shared_bytes: base.limits.max_compute_shared_memory_size,
            max_invocations,
            max_allocation_bytes: limits_11.max_memory_allocation_size,
            has_budget: has(ash::ext::memory_budget::NAME),
            can_fill_subgroups,
            shaders: ShaderKind {
                vendor: base.vendor_id,
                device: base.device_id,
                driver: base.pipeline_cache_uuid,
                driver_version: base.driver_version,
            },
            subgroup_lanes: limits_11
                .subgroup_supported_operations
                .contains(
                    vk::SubgroupFeatureFlags::VOTE
                        | vk::SubgroupFeatureFlags::BALLOT
                        | vk::SubgroupFeatureFlags::SHUFFLE
                        | vk::SubgroupFeatureFlags::ARITHMETIC,
                )
                .then_some(limits_11.subgroup_size),
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: devices hold an `Arc` of the instance, so none is left; the messenger goes
        // before the counter that it points to.
        unsafe {
            if let Some(v) = &self.validation {
                v.functions.destroy_debug_utils_messenger(v.messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

/// Counts and logs one message of the validation layer.
unsafe extern "system" fn complaint(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    counter: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes valid data, and as counter what `watch` registered.
    let (text, counter) = unsafe {
        let text = (*data).message_as_c_str().unwrap_or(c"");
        (text.to_string_lossy(), &*counter.cast::<AtomicUsize>())
    };
    counter.fetch_add(1, Ordering::Relaxed);
    tracing::error!(%text, "Vulkan validation");
    vk::FALSE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_read_as_written() {
        assert_eq!("gpu".parse(), Ok(DeviceChoice::Any));
        assert_eq!("gpu:2".parse(), Ok(DeviceChoice::Number(2)));
        assert_eq!("gpu:all".parse(), Ok(DeviceChoice::All));
        for wrong in ["", "cpu", "gpu:", "gpu:-1", "gpu2", "gpu:1:1"] {
            assert!(wrong.parse::<DeviceChoice>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn hardware_comes_before_programs() {
        let mut kinds = [
            DeviceKind::Cpu,
            DeviceKind::Integrated,
            DeviceKind::Discrete,
        ];
        kinds.sort();
        assert_eq!(
            kinds,
            [
                DeviceKind::Discrete,
                DeviceKind::Integrated,
                DeviceKind::Cpu
            ]
        );
    }
}

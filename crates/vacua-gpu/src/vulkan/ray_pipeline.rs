//! Ray tracing pipelines: one ray generation shader, what is met, what is not, and the tables in which
//! devices look them up.

use std::sync::Arc;
use std::time::Instant;

use ash::vk;

use super::pipeline::{Module, Special};
use super::{Buffer, Constant, Device, Layout, Named, Place};
use crate::error::GpuError;

/// The compiled shaders of a pipeline.
pub(crate) struct RayShaders<'a> {
    pub generation: &'a [u32],
    pub miss: &'a [u32],
    pub closest_hit: Option<&'a [u32]>,
    pub any_hit: Option<&'a [u32]>,
    /// For boxes; triangles need none.
    pub intersection: Option<&'a [u32]>,
}

/// A ray tracing pipeline with its tables.
pub(crate) struct RayPipeline {
    device: Arc<Device>,
    raw: vk::Pipeline,
    tables: [vk::StridedDeviceAddressRegionKHR; 3],
    /// Holds the tables.
    memory: Option<Buffer>,
}

/// Groups of shaders: ray generation, miss, hit.
const NUM_GROUPS: u32 = 3;

impl RayPipeline {
    /// Compiles the shaders; constants are those of all of them.
    pub fn new(
        layout: &Layout,
        shaders: &RayShaders<'_>,
        constants: &[Constant],
    ) -> Result<Self, GpuError> {
        let device = layout.device();
        let name = device.name();
        let lacking = || GpuError::Unsupported {
            what: "a ray tracing pipeline".to_owned(),
            device: name.to_owned(),
        };
        let functions = device.ray_functions().and_then(|f| f.pipelines.as_ref());
        let functions = functions.ok_or_else(lacking)?;
        let special = Special::new(constants);
        let info = special.info();
        let mut modules = Vec::new();
        let mut kinds = Vec::new();
        let given = [
            (Some(shaders.generation), vk::ShaderStageFlags::RAYGEN_KHR),
            (Some(shaders.miss), vk::ShaderStageFlags::MISS_KHR),
            (shaders.closest_hit, vk::ShaderStageFlags::CLOSEST_HIT_KHR),
            (shaders.any_hit, vk::ShaderStageFlags::ANY_HIT_KHR),
            (shaders.intersection, vk::ShaderStageFlags::INTERSECTION_KHR),
        ];
        for (spirv, kind) in given {
            if let Some(spirv) = spirv {
                modules.push(Module::new(device, spirv)?);
                kinds.push(kind);
            }
        }
        let stages: Vec<vk::PipelineShaderStageCreateInfo> = modules
            .iter()
            .zip(&kinds)
            .map(|(module, &kind)| {
                vk::PipelineShaderStageCreateInfo::default()
                    .stage(kind)
                    .module(module.raw())
                    .name(c"main")
                    .specialization_info(&info)
            })
            .collect();
        let group = |ty| {
            vk::RayTracingShaderGroupCreateInfoKHR::default()
                .ty(ty)
                .general_shader(vk::SHADER_UNUSED_KHR)
                .closest_hit_shader(vk::SHADER_UNUSED_KHR)
                .any_hit_shader(vk::SHADER_UNUSED_KHR)
                .intersection_shader(vk::SHADER_UNUSED_KHR)
        };
        let number_of = |wanted| {
            let place = kinds.iter().position(|&kind| kind == wanted);
            place.map_or(vk::SHADER_UNUSED_KHR, |n| n as u32)
        };
        let hit = match shaders.intersection {
            None => vk::RayTracingShaderGroupTypeKHR::TRIANGLES_HIT_GROUP,
            Some(_) => vk::RayTracingShaderGroupTypeKHR::PROCEDURAL_HIT_GROUP,
        };
        let general = vk::RayTracingShaderGroupTypeKHR::GENERAL;
        let groups = [
            group(general).general_shader(0),
            group(general).general_shader(1),
            group(hit)
                .closest_hit_shader(number_of(vk::ShaderStageFlags::CLOSEST_HIT_KHR))
                .any_hit_shader(number_of(vk::ShaderStageFlags::ANY_HIT_KHR))
                .intersection_shader(number_of(vk::ShaderStageFlags::INTERSECTION_KHR)),
        ];
        let create = [vk::RayTracingPipelineCreateInfoKHR::default()
            .stages(&stages)
            .groups(&groups)
            .max_pipeline_ray_recursion_depth(1)
            .layout(layout.raw())];
        let start = Instant::now();
        // SAFETY: everything that `create` points to is alive.
        let made = unsafe {
            functions.create_ray_tracing_pipelines(
                vk::DeferredOperationKHR::null(),
                layout.shaders().raw(),
                &create,
                None,
            )
        };
        let made = made
            .map_err(|(_, result)| result)
            .named("compiling ray tracing shaders", name)?;
        let secs = start.elapsed().as_secs_f64();
        let words: usize = given
            .iter()
            .filter_map(|(spirv, _)| Some(spirv.as_ref()?.len()))
            .sum();
        tracing::debug!(words, secs, "ray tracing shaders, compiled or known");
        let mut pipeline = Self {
            device: device.clone(),
            raw: made[0],
            tables: Default::default(),
            memory: None,
        };
        pipeline.fill_tables(functions)?;
        Ok(pipeline)
    }

    /// One table a group, each with one handle.
    fn fill_tables(
        &mut self,
        functions: &ash::khr::ray_tracing_pipeline::Device,
    ) -> Result<(), GpuError> {
        let Some(limits) = self.device.info().ray_tracing else {
            return Ok(());
        };
        let handle = limits.handle_bytes as usize;
        let stride = limits
            .handle_bytes
            .next_multiple_of(limits.handle_alignment.max(1));
        let apart = stride.next_multiple_of(limits.table_alignment.max(1));
        // SAFETY: the pipeline has this many groups.
        let handles = unsafe {
            functions.get_ray_tracing_shader_group_handles(
                self.raw,
                0,
                NUM_GROUPS,
                NUM_GROUPS as usize * handle,
            )
        }
        .named("asking for shader handles", self.device.name())?;
        let size = (u64::from(NUM_GROUPS) + 1) * apart;
        let mut memory = Buffer::new(&self.device, "shader tables", size, Place::Shared)?;
        let first = memory
            .address()
            .next_multiple_of(limits.table_alignment.max(1));
        let skipped = first - memory.address();
        for (i, handle) in handles.chunks_exact(handle).enumerate() {
            let at = i as u64 * apart;
            let start = (skipped + at) as usize;
            memory.bytes_mut()[start..start + handle.len()].copy_from_slice(handle);
            self.tables[i] = vk::StridedDeviceAddressRegionKHR {
                device_address: first + at,
                stride,
                size: stride,
            };
        }
        self.memory = Some(memory);
        Ok(())
    }

    pub fn raw(&self) -> vk::Pipeline {
        self.raw
    }

    /// Where ray generation, miss and hit shaders are looked up.
    pub fn tables(&self) -> &[vk::StridedDeviceAddressRegionKHR; 3] {
        &self.tables
    }
}

impl Drop for RayPipeline {
    fn drop(&mut self) {
        // SAFETY: submissions are waited for, so nothing uses the pipeline.
        unsafe { self.device.raw().destroy_pipeline(self.raw, None) }
    }
}

//! What renders: the CPU, or a GPU where there is one.

mod shader_folder;

use std::path::PathBuf;
use std::str::FromStr;

use vacua_gpu::{DeviceChoice, GpuError, GpuGroup, GpuRenderer};
use vacua_render::{CpuRenderer, RenderError, RenderSettings, Renderer, Rendering, Scene};

use self::shader_folder::ShaderFolder;

/// What renders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// A GPU if there is one that can render the scene, else the CPU.
    #[default]
    Auto,
    /// The CPU, with all threads.
    Cpu,
    /// The best Vulkan device, even one that is a program on the CPU; or one by its number.
    Gpu(Option<usize>),
    /// All Vulkan devices that are hardware, each making a part of every picture.
    AllGpus,
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "cpu" => Ok(Self::Cpu),
            other => match other.parse() {
                Ok(DeviceChoice::Number(number)) => Ok(Self::Gpu(Some(number))),
                Ok(DeviceChoice::All) => Ok(Self::AllGpus),
                Ok(_) => Ok(Self::Gpu(None)),
                Err(_) => Err(format!(
                    "expected auto, cpu, gpu, gpu:N or gpu:all, found `{other}`"
                )),
            },
        }
    }
}

/// What rendered the last picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Last {
    /// The GPU, or nothing has been rendered.
    Gpu,
    /// The CPU.
    Cpu,
}

/// A renderer on a device, or on whichever one fits.
pub struct Backend {
    gpu: Option<GpuGroup>,
    cpu: Option<CpuRenderer>,
    threads: Option<usize>,
    /// Whether the CPU may step in for the GPU.
    is_auto: bool,
    last: Last,
    /// Why the CPU renders, if a GPU was looked for.
    reason: Option<String>,
    /// Whether the GPU has rendered anything.
    has_rendered: bool,
    /// Where shaders that the GPU has compiled are kept, if they are.
    shaders: Option<ShaderFolder>,
}

impl Backend {
    /// A renderer for a device; `threads` are those of the CPU, all that there are if not given.
    ///
    /// # Errors
    /// [`RenderError::Device`] if a GPU was asked for and there is none, [`RenderError::Threads`].
    pub fn new(device: Device, threads: Option<usize>) -> Result<Self, RenderError> {
        let mut backend = Self {
            gpu: None,
            cpu: None,
            threads,
            is_auto: device == Device::Auto,
            last: Last::Gpu,
            reason: None,
            has_rendered: false,
            shaders: None,
        };
        let choice = match device {
            Device::Auto => DeviceChoice::Hardware,
            Device::Cpu => {
                backend.cpu = Some(CpuRenderer::new(threads)?);
                return Ok(backend);
            }
            Device::Gpu(None) => DeviceChoice::Any,
            Device::Gpu(Some(number)) => DeviceChoice::Number(number),
            Device::AllGpus => DeviceChoice::All,
        };
        match GpuGroup::new(choice) {
            Ok(gpu) => backend.gpu = Some(gpu),
            Err(error) if backend.is_auto => backend.fall_back(&error)?,
            Err(error) => return Err(error.into()),
        }
        Ok(backend)
    }

    /// Keeps shaders that a GPU compiles in a folder, a file for each model, and takes those that are there:
    /// compiling them takes some drivers seconds. To be called before anything is rendered. They are written when
    /// this is dropped, or the CPU takes over, if the GPU has rendered; where it failed the files are removed.
    /// That none can be read or written is no error; the log says so.
    pub fn keep_shaders_in(&mut self, folder: impl Into<PathBuf>) {
        let mut folder = ShaderFolder::new(folder.into());
        if let Some(gpu) = &mut self.gpu {
            folder.read(gpu.members_mut());
            self.shaders = Some(folder);
        }
    }

    fn write_shaders(&mut self) {
        if let (Some(folder), Some(gpu), true) = (&self.shaders, &mut self.gpu, self.has_rendered) {
            folder.write(gpu.members_mut());
        }
    }

    fn discard_shaders(&mut self) {
        if let (Some(folder), Some(gpu)) = (self.shaders.take(), &self.gpu) {
            folder.discard(gpu.members());
        }
    }

    /// Goes on with the CPU.
    fn fall_back(&mut self, error: &dyn std::error::Error) -> Result<(), RenderError> {
        tracing::info!(%error, "rendering on the CPU");
        self.reason = Some(error.to_string());
        self.write_shaders();
        self.gpu = None;
        self.cpu = Some(CpuRenderer::new(self.threads)?);
        Ok(())
    }

    fn on_cpu(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<Rendering, RenderError> {
        self.last = Last::Cpu;
        match &mut self.cpu {
            Some(cpu) => cpu.render(scene, settings),
            None => self
                .cpu
                .insert(CpuRenderer::new(self.threads)?)
                .render(scene, settings),
        }
    }

    /// What rendered last, or will: `cpu`, or `gpu:N` and the name of the device, of each if there are several.
    pub fn name(&self) -> String {
        let Some(group) = self.gpu.as_ref().filter(|_| self.last == Last::Gpu) else {
            return "cpu".to_owned();
        };
        let name = |gpu: &GpuRenderer| {
            let info = gpu.device().info();
            format!("gpu:{} {}", info.number, info.name)
        };
        let names: Vec<String> = group.members().iter().map(name).collect();
        names.join(", ")
    }

    /// Why the CPU renders, if a GPU was looked for.
    pub fn reason(&self) -> Option<&str> {
        self.reason.as_deref()
    }

    /// The renderer on the CPU, if it has rendered.
    pub fn cpu(&self) -> Option<&CpuRenderer> {
        self.cpu.as_ref()
    }

    /// The renderer on the GPU, if that is what rendered last; the first one if there are several.
    pub fn gpu(&self) -> Option<&GpuRenderer> {
        let group = self.gpu.as_ref().filter(|_| self.last == Last::Gpu);
        group?.members().first()
    }
}

impl Drop for Backend {
    fn drop(&mut self) {
        self.write_shaders();
    }
}

impl Renderer for Backend {
    /// Renders one picture. Where the GPU was chosen automatically and cannot render the scene, the
    /// CPU does, from then on.
    fn render(
        &mut self,
        scene: &Scene,
        settings: &RenderSettings,
    ) -> Result<Rendering, RenderError> {
        self.last = Last::Gpu;
        let Some(gpu) = &mut self.gpu else {
            return self.on_cpu(scene, settings);
        };
        let error = match gpu.render(scene, settings) {
            Ok(rendering) => {
                self.has_rendered = true;
                return Ok(rendering);
            }
            Err(RenderError::Device(error)) => error,
            Err(other) => return Err(other),
        };
        let known = error.downcast_ref::<GpuError>();
        if let Some(GpuError::Lost { .. } | GpuError::Vulkan { .. }) | None = known {
            tracing::warn!(%error, "the GPU failed");
            self.discard_shaders();
        }
        if !self.is_auto {
            return Err(RenderError::Device(error));
        }
        if let Some(GpuError::Detail { .. }) = known {
            // Exact pictures of the same scene may follow on the GPU.
            self.reason = Some(error.to_string());
        } else {
            self.fall_back(&*error)?;
        }
        self.on_cpu(scene, settings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_read_as_written() {
        assert_eq!("auto".parse(), Ok(Device::Auto));
        assert_eq!("cpu".parse(), Ok(Device::Cpu));
        assert_eq!("gpu".parse(), Ok(Device::Gpu(None)));
        assert_eq!("gpu:3".parse(), Ok(Device::Gpu(Some(3))));
        assert_eq!("gpu:all".parse(), Ok(Device::AllGpus));
        for wrong in ["", "GPU", "gpu:", "gpu:x", "cpu:1"] {
            assert!(wrong.parse::<Device>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_device_that_does_not_exist_is_refused() {
        let error = Backend::new(Device::Gpu(Some(999)), Some(1)).err();
        assert!(matches!(error, Some(RenderError::Device(_))), "{error:?}");
    }
}

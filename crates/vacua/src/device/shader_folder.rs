//! A folder in which shaders that a GPU has compiled are kept from run to run, a file for each model.
//!
//! It only saves time: what cannot be read or written, is damaged, or comes from another version of the
//! driver is said in the log and does without.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::PathBuf;

use vacua_gpu::GpuRenderer;
use vacua_io::write_atomically;

/// Bytes that a file may have; a driver's shaders for all that vacua does are a tenth of it.
const MOST_BYTES: u64 = 256 << 20;

/// A folder of compiled shaders.
pub(super) struct ShaderFolder {
    folder: PathBuf,
    /// Bytes of the shaders that each renderer was given, 0 if there were none.
    known: Vec<usize>,
}

impl ShaderFolder {
    pub fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            known: Vec::new(),
        }
    }

    fn file_of(&self, gpu: &GpuRenderer) -> PathBuf {
        let model = gpu.device().info().model();
        self.folder.join(format!("{model}.shaders"))
    }

    /// Gives renderers the shaders that earlier runs have compiled.
    pub fn read(&mut self, gpus: &mut [GpuRenderer]) {
        self.known = gpus.iter_mut().map(|gpu| self.read_for(gpu)).collect();
    }

    /// Bytes of the shaders that a renderer then has, 0 if it could take none.
    fn read_for(&self, gpu: &mut GpuRenderer) -> usize {
        let path = self.file_of(gpu);
        let mut shaders = Vec::new();
        let read =
            File::open(&path).and_then(|file| file.take(MOST_BYTES).read_to_end(&mut shaders));
        if let Err(error) = read {
            tracing::debug!(path = %path.display(), %error, "no compiled shaders");
            return 0;
        }
        match gpu.add_compiled_shaders(&shaders) {
            Ok(true) => return gpu.compiled_shaders().map_or(0, |all| all.len()),
            Ok(false) => {
                tracing::info!(path = %path.display(), "shaders of another driver, or damaged");
            }
            Err(error) => {
                tracing::warn!(path = %path.display(), %error, "compiled shaders are not used");
            }
        }
        0
    }

    /// Writes the shaders of renderers that have compiled any since they were read.
    pub fn write(&self, gpus: &[GpuRenderer]) {
        for (i, gpu) in gpus.iter().enumerate() {
            let Ok(shaders) = gpu.compiled_shaders() else {
                continue;
            };
            let is_known = self.known.get(i) == Some(&shaders.len());
            if is_known || shaders.len() as u64 > MOST_BYTES {
                continue;
            }
            let path = self.file_of(gpu);
            if let Err(error) = std::fs::create_dir_all(&self.folder) {
                tracing::info!(path = %self.folder.display(), %error, "compiled shaders are not kept");
                return;
            }
            match write_atomically(&path, |file| file.write_all(&shaders)) {
                Ok(()) => {
                    tracing::debug!(path = %path.display(), bytes = shaders.len(), "compiled shaders kept");
                }
                Err(error) => tracing::info!(%error, "compiled shaders are not kept"),
            }
        }
    }
}

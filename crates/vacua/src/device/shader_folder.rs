//! A folder in which shaders that a GPU has compiled are kept from run to run, a file for each model.
//!
//! It only saves time: what cannot be read or written, is damaged, or comes from another version of the
//! driver or of vacua is said in the log and does without. Who writes a file adds what others have written
//! into it meanwhile.

use std::fs::File;
use std::io::{ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};

use vacua_gpu::{GpuError, GpuRenderer};
use vacua_io::write_atomically;

/// Bytes that a file may have: shaders of six kinds of pictures on an H100 are 1.3 MB.
const MOST_BYTES: u64 = 256 << 20;

/// A folder of compiled shaders.
pub(super) struct ShaderFolder {
    folder: PathBuf,
    /// Bytes of each renderer's shaders that its file has, if that was taken.
    known: Vec<Option<usize>>,
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

    /// Gives renderers the shaders that earlier runs have compiled; to be called before they compile any.
    pub fn read(&mut self, gpus: &mut [GpuRenderer]) {
        let known = |gpu: &mut GpuRenderer| {
            let path = self.file_of(gpu);
            let is_taken = logged(&path, take(gpu, &path))?;
            logged(&path, gpu.compiled_shaders())
                .filter(|_| is_taken)
                .map(|all| all.len())
        };
        self.known = gpus.iter_mut().map(known).collect();
    }

    /// Writes the shaders of renderers that have compiled any since they were read.
    pub fn write(&self, gpus: &mut [GpuRenderer]) {
        for (gpu, known) in gpus.iter_mut().zip(&self.known) {
            let path = self.file_of(gpu);
            let is_new = |all: &Vec<u8>| *known != Some(all.len());
            let Some(_) = logged(&path, gpu.compiled_shaders()).filter(is_new) else {
                continue;
            };
            // Another program, or another renderer here, may have written since.
            logged(&path, take(gpu, &path));
            let Some(all) = logged(&path, gpu.compiled_shaders()) else {
                continue;
            };
            if all.len() as u64 > MOST_BYTES {
                tracing::warn!(path = %path.display(), "compiled shaders have become too many; the file is removed");
                remove(&path);
                continue;
            }
            let written = std::fs::create_dir_all(&self.folder)
                .map_err(|error| error.to_string())
                .and_then(|()| {
                    let write = |file: &mut std::io::BufWriter<&File>| file.write_all(&all);
                    write_atomically(&path, write).map_err(|error| error.to_string())
                });
            match written {
                Ok(()) => {
                    tracing::debug!(path = %path.display(), bytes = all.len(), "compiled shaders kept");
                }
                Err(error) => {
                    tracing::info!(path = %path.display(), error, "compiled shaders are not kept");
                }
            }
        }
    }

    /// Removes the files of renderers, one of which has failed: it may be they that make it fail.
    pub fn discard(&self, gpus: &[GpuRenderer]) {
        gpus.iter().for_each(|gpu| remove(&self.file_of(gpu)));
    }
}

/// Whether a file was taken.
fn take(gpu: &mut GpuRenderer, path: &Path) -> Result<bool, GpuError> {
    let mut shaders = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MOST_BYTES).read_to_end(&mut shaders));
    if let Err(error) = read {
        tracing::debug!(path = %path.display(), %error, "no compiled shaders");
        return Ok(false);
    }
    let is_taken = gpu.add_compiled_shaders(&shaders)?;
    if !is_taken {
        tracing::info!(path = %path.display(), "shaders of another driver or version, or damaged");
    }
    Ok(is_taken)
}

fn logged<T>(path: &Path, result: Result<T, GpuError>) -> Option<T> {
    result
        .inspect_err(|error| tracing::warn!(path = %path.display(), %error, "compiled shaders"))
        .ok()
}

fn remove(path: &Path) {
    match std::fs::remove_file(path) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(error) => tracing::info!(path = %path.display(), %error, "compiled shaders stay"),
    }
}

//! Paper B's Tables 3, 4 and 6 on a GPU: meshes packed and in the encodings that those are compared with,
//! all of them on the device, with what they take there.
//!
//! One integrator makes all pictures, without skipping and with the same samples; every difference to the
//! packed form's is counted. Times are those of the device's own clock, and bytes of acceleration
//! structures those that the driver asks for, compacted.

mod markdown;
mod measure;

use serde::{Deserialize, Serialize};
use vacua_gpu::{DeviceChoice, GpuRenderer};

use crate::cell::Cell;
use crate::error::BenchError;
use crate::gpu_mesh::MeshChoice;
use crate::machine::Machine;
use crate::meshes::Scene;
use crate::sample::{Share, ShareResult};

/// What to measure.
#[derive(Clone, Debug)]
pub struct GpuReferenceOptions {
    /// On which device.
    pub device: DeviceChoice,
    /// Which meshes.
    pub meshes: Vec<MeshChoice>,
    /// Whether points and cells come in random order.
    pub shuffled: bool,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// Frames of which the median counts.
    pub repeats: usize,
    /// Random places that are sampled at once; 0 for none.
    pub places: usize,
    /// Shares of the first mesh for Tables 4 and 6.
    pub shares: Vec<Share>,
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GpuReferenceResults {
    /// Where and when.
    pub machine: Machine,
    /// Name of the device.
    pub device: String,
    /// Pixels a row and rows.
    pub size: (usize, usize),
    /// Random places.
    pub places: usize,
    /// One entry a mesh.
    pub meshes: Vec<ReferenceMesh>,
    /// Tables 4 and 6, of the first mesh; times are those of the device.
    pub shares: Vec<ShareResult>,
}

/// Everything about one mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceMesh {
    /// Which kind.
    pub model: Scene,
    /// Cells a side, about.
    pub size: usize,
    /// Its cells.
    pub cells: Cell<u64>,
    /// Samples of its picture.
    pub samples: u64,
    /// Packed variants 2 and 1, then references.
    pub peers: Vec<DevicePeer>,
}

/// One way to hold a mesh on the device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DevicePeer {
    /// Its name.
    pub name: String,
    /// Nodes, of packed ones.
    pub nodes: Option<u64>,
    /// Sub-meshes, of packed ones.
    pub submeshes: Option<u64>,
    /// Bytes of the file's sections, of packed ones: geometry and one field.
    pub file_bytes: Option<u64>,
    /// Bytes on the device by part.
    pub parts: Vec<(String, u64)>,
    /// All of them.
    pub bytes: Cell<u64>,
    /// Seconds to send it and to build its acceleration structure; those on the host before are not
    /// counted for packed ones.
    pub send_secs: Cell<f64>,
    /// Median seconds of a picture on the device.
    pub march_secs: Cell<f64>,
    /// Samples a second in a picture.
    pub rays_per_sec: Cell<f64>,
    /// Samples a second at random places.
    pub random_per_sec: Cell<f64>,
    /// Pixels that are not those of packed variant 2 to the bit.
    pub num_different: Cell<u64>,
    /// The largest difference of a channel to it.
    pub difference: Cell<f64>,
}

impl GpuReferenceResults {
    /// The tables for people.
    pub fn markdown(&self) -> String {
        markdown::all(self)
    }
}

/// Measures all tables.
///
/// # Errors
/// [`BenchError`] if there is no device; all else is said in the cells that it empties.
pub fn run(options: &GpuReferenceOptions) -> Result<GpuReferenceResults, BenchError> {
    let mut gpu = GpuRenderer::new(options.device)?;
    Ok(GpuReferenceResults {
        machine: Machine::describe(rayon::current_num_threads()),
        device: gpu.device().name().to_owned(),
        size: options.size,
        places: options.places,
        meshes: options
            .meshes
            .iter()
            .map(|&choice| measure::mesh(&mut gpu, options, choice))
            .collect(),
        shares: measure::shares(&mut gpu, options),
    })
}

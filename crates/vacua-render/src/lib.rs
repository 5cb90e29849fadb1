//! Scene, camera, frame, and the integrators on the CPU.
//!
//! A [`Scene`] is a field on a grid or a mesh, a transfer function and a camera; [`RenderSettings`] say how its
//! picture is made; a [`Renderer`] makes the [`Frame`]. Whatever the settings for skipping, the
//! picture is the same to the bit.

mod accumulate;
mod ahead;
mod auto;
mod blocks;
mod camera;
pub mod contract;
mod cpu;
mod data;
mod error;
mod frame;
mod lift;
mod light;
mod march;
mod overlay;
mod packed;
mod point;
mod progressive;
mod sampler;
mod scene;
mod setup;
mod space;
mod stage;
mod tiles;
mod voxels;

pub use accumulate::Accumulator;
pub use camera::{Camera, CameraError, Projection, View, ViewBasis};
pub use cpu::{CpuRenderer, DEFAULT_MACROCELL_SIDE, RenderReport, Renderer, Rendering};
pub use data::SceneData;
pub use error::RenderError;
pub use frame::Frame;
pub use point::VolumeSampler;
pub use progressive::Progressive;
pub use scene::{
    ClipPlane, Detail, Integrator, Jitter, Overlay, RenderSettings, Scene, Shading, SkipMethod,
};

//! Scientific volume rendering that skips what is empty and packs what is not.
//!
//! From a file to a picture:
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let (file, picture) = (folder.path().join("v_20x20x20_uint8.raw"), folder.path().join("v.png"));
//! # let ball = |i: usize| {
//! #     let from_middle = |n: usize| (n as f64 - 9.5).powi(2);
//! #     let r = (from_middle(i % 20) + from_middle(i / 20 % 20) + from_middle(i / 400)).sqrt();
//! #     (255.0 * (1.0 - r / 17.0)) as u8
//! # };
//! # std::fs::write(&file, (0..8000).map(ball).collect::<Vec<u8>>())?;
//! let volume = vacua::open(file)?;
//! let scene = vacua::Scene::new(volume)
//!     .transfer_function(vacua::TransferFunction::preset("viridis").opacity_ramp(0.2..=1.0))
//!     .camera(vacua::Camera::orbit(30.0, 20.0));
//! let frame = vacua::renderer(vacua::Device::Auto)?.render(&scene)?;
//! frame.save(picture)?;
//! # assert!(!frame.is_blank());
//! # assert_eq!(frame.explain_blank(&scene)?, None);
//! # Ok(())
//! # }
//! ```
//!
//! What is behind these lines lies in the modules [`volume`] (grids, fields, transfer functions),
//! [`io`] (files), [`skip`] (empty space), [`pack`] (encoded meshes), [`render`] (scenes, renderers, frames), [`gpu`] (the same
//! on Vulkan) and [`synth`] (procedural data).
#![forbid(unsafe_code)]

mod blank;
mod content;
mod device;
mod quick;

pub use vacua_gpu as gpu;
pub use vacua_io as io;
pub use vacua_pack as pack;
pub use vacua_render as render;
pub use vacua_skip as skip;
pub use vacua_synth as synth;
pub use vacua_volume as volume;

pub use blank::explain_blank;
pub use content::{Content, open, open_with, with_own_format};
pub use device::{Backend, Device};
pub use quick::{Error, Frame, Look, Renderer, Scene, renderer};
pub use vacua_render::{
    Camera, ClipPlane, Detail, Integrator, Jitter, Overlay, RenderSettings, Shading, SkipMethod,
};
pub use vacua_volume::{Dataset, TransferFunction, TransferStyle, Volume};

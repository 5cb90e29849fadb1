//! vacua's scenes on Vulkan: the pictures of the CPU's renderer, in real time.
//!
//! [`Instance`] finds the loader when the program runs and lists devices by what they can do;
//! [`GpuRenderer`] is a [`vacua_render::Renderer`] on one of them. Everything stays on the device
//! between frames: voxels, macrocell ranges, the transfer table, the distance map that rays skip by.
//! An edit of the transfer function is one submission together with its frame, and needs nothing
//! back from the device.
//!
//! Positions, classification and compositing are those of the contract that `vacua_render` keeps, so
//! that skipping changes no bit of a device's own picture; against the CPU's, pictures differ by
//! rounding.

mod error;
mod frame;
mod group;
mod mesh;
mod reference;
mod renderer;
mod send;
mod shaders;
mod shared;
mod skip;
mod table;
mod view;
mod volume;
mod vulkan;

pub use error::GpuError;
pub use group::GpuGroup;
pub use mesh::MeshBytes;
pub use reference::{MeshEncoding, MeshReference};
pub use renderer::{
    Boundary, GpuOptions, GpuRenderer, MeshSample, Search, StructureOptions, Tracer,
};
pub use vulkan::{Device, DeviceChoice, DeviceInfo, DeviceKind, Instance, Preference, Timings};

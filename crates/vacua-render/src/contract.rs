//! What other renderers need in order to make the same pictures: where samples are, and what they
//! are worth.

pub use vacua_simd::BLOCK;

pub use crate::blocks::{LatticeMinima, MAX_LEVEL, SpanMinima};
pub use crate::cpu::{check, pixel_offset};
pub use crate::light::{LIGHT, LightModel};
pub use crate::packed::PackedCells;
pub use crate::setup::GOLDEN;
pub use crate::space::RaySpace;

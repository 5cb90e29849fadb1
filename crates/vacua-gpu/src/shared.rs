//! What the host tells all shaders: the one description on this side of `shared.glsl`. A test
//! reflects the compiled shaders and compares name, offset and size of every member.

use bytemuck::{Pod, Zeroable};

/// Images that a volume is split into, at most.
pub(crate) const MAX_SLABS: usize = 16;

/// Side of the square of pixels that a workgroup of the march makes.
pub(crate) const TILE: u32 = 16;

/// Farthest distance that the map of macrocells tells.
pub(crate) const MAX_REACH: u8 = 127;

/// Runs of samples that a ray may have.
pub(crate) const MAX_RUNS: u32 = 8;

/// Invocations of a workgroup that works on macrocells, four to each.
pub(crate) const GROUP: u32 = 256;

/// Lattice points along each axis of a brick, in which a workgroup looks for faces of the boundary.
pub(crate) const BRICK: [u32; 3] = [16, 16, 8];

/// Words that describe a face of the boundary, and numbers of its corners.
pub(crate) const FACE_WORDS: u64 = 3;
pub(crate) const FACE_NUMBERS: u64 = 18;

/// Children of a node of our own hierarchy over faces, words that describe one, and invocations of a
/// workgroup that builds a level of it.
pub(crate) const TREE_WIDTH: u32 = 32;
pub(crate) const NODE_WORDS: u64 = 3;
pub(crate) const TREE_GROUP: u64 = 64;

/// Numbers of the constants that pipelines are specialised by.
pub(crate) mod constant {
    pub const SKIPPING: u32 = 0;
    pub const CELL_DATA: u32 = 1;
    pub const CHECK_FINITE: u32 = 2;
    pub const LOG_SCALE: u32 = 3;
    pub const SHADED: u32 = 4;
    pub const MAXIMUM: u32 = 5;
    pub const BLANKED: u32 = 6;
    pub const RECTILINEAR: u32 = 7;
    pub const NUM_SLABS: u32 = 8;
    pub const LANES: u32 = 9;
    pub const SUBGROUPS: u32 = 10;
    pub const INVOCATIONS: u32 = 11;
}

/// The uniform block `Parameters`; what each member means is said in `shared.glsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Parameters {
    pub rate: [f64; 4],
    pub rate_x: [f64; 4],
    pub rate_y: [f64; 4],
    pub grid: [f64; 4],
    pub anchor: [f32; 4],
    pub anchor_x: [f32; 4],
    pub anchor_y: [f32; 4],
    pub direction: [f32; 4],
    pub direction_x: [f32; 4],
    pub direction_y: [f32; 4],
    pub length_sq: [f32; 4],
    pub box_lo: [f32; 4],
    pub box_hi: [f32; 4],
    pub texel: [f32; 4],
    pub table_scale: [f32; 4],
    pub metric_squares: [f32; 4],
    pub metric_products: [f32; 4],
    pub bins_per_unit: [f32; 4],
    pub last_cell: [f32; 4],
    pub cells: [u32; 4],
    pub macrocells: [u32; 4],
    pub axis_offset: [u32; 4],
    pub picture: [u32; 4],
    pub light: [f32; 4],
    pub faces: u64,
    pub corners: u64,
    pub face_counts: u64,
    pub bricks: u64,
    pub nodes: u64,
    pub num_face_groups: u32,
    pub flange: f32,
    pub num_shapes: u32,
    pub tree_height: u32,
}

/// The push constants `Push`; buffers by their address.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Push {
    pub table: u64,
    pub next_active: u64,
    pub ranges: u64,
    pub skip: u64,
    pub skip_before: u64,
    pub counter: u64,
    pub planes: u64,
    pub blanked: u64,
    pub clips: u64,
    pub rgba: u64,
    pub depth: u64,
    pub samples: u64,
    pub runs: u64,
    pub offset: [f32; 2],
    pub jitter: f32,
    pub weight: f32,
    pub frame: u32,
    pub pass: u32,
}

/// The words of a compiled shader; `None` if it is none.
pub(crate) fn words(spirv: &[u8]) -> Option<Vec<u32>> {
    const MAGIC: u32 = 0x0723_0203;
    if !spirv.len().is_multiple_of(4) {
        return None;
    }
    let words: Vec<u32> = spirv
        .chunks_exact(4)
        .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect();
    (words.first() == Some(&MAGIC)).then_some(words)
}

#[cfg(test)]
mod tests;

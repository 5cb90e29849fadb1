//! The packed form and what it is compared with, behind one interface.

use vacua_pack::reference::{
    Cells, LinkedBvh, MinMaxBvh, Places, Reference, ReferenceError, SharedFaces, TetMarch,
    UserGeometry,
};
use vacua_pack::{BlockSampler, Order, PackedField, PackedMesh, Sampled};
use vacua_simd::LANES;

use super::picture::{TILE, TILE_RAYS, Tile};

/// One way to hold a mesh, ready to be sampled.
pub(super) enum Peer<'a> {
    /// The packed form.
    Packed(BlockSampler<'a>),
    /// A reference encoding.
    Reference(&'a dyn Reference),
}

impl<'a> Peer<'a> {
    /// The packed form of a mesh.
    pub fn packed(mesh: &'a PackedMesh, field: &'a PackedField) -> Self {
        Self::Packed(BlockSampler::new(mesh, field, None))
    }

    /// The sum of the values at places, sixteen at a time.
    pub fn sum(&self, blocks: &[Places], order: Order) -> f32 {
        match self {
            Self::Packed(sampler) => {
                let lanes = vec![u16::MAX; blocks.len()];
                let mut sampled = vec![Sampled::default(); blocks.len()];
                sampler.sample_all(order, blocks, &lanes, &mut sampled);
                sampled.iter().flat_map(|s| s.values).sum()
            }
            Self::Reference(reference) => {
                let values = |at| {
                    let found = reference.sample(at, u16::MAX);
                    let is_valid = |lane: &usize| found.valid >> lane & 1 == 1;
                    let lanes = (0..LANES).filter(is_valid);
                    lanes.map(|lane| found.values[lane]).sum::<f32>()
                };
                blocks.iter().map(values).sum()
            }
        }
    }

    /// Values of the samples of a tile, ray after ray; NaN where there is none.
    pub fn sample_tile(&self, tile: &Tile, values: &mut Vec<f32>) {
        values.clear();
        values.resize(tile.num_samples(), f32::NAN);
        match self {
            Self::Packed(sampler) => packed_tile(sampler, tile, values),
            Self::Reference(reference) => {
                let mut rest = &mut values[..];
                for (ray, &count) in tile.rays.iter().zip(&tile.counts) {
                    let (of_ray, more) = rest.split_at_mut(count as usize);
                    if count > 0 {
                        reference.sample_ray(ray, of_ray);
                    }
                    rest = more;
                }
            }
        }
    }
}

/// Samples of a ray in a vector.
const IN_VECTOR: usize = 4;

/// The rays of a tile through the packed form, sixteen consecutive samples of all of them together: a
/// vector holds four samples of 2 × 2 rays, which lie closest.
fn packed_tile(sampler: &BlockSampler, tile: &Tile, values: &mut [f32]) {
    // Where the values of each ray begin.
    let mut places = [0; TILE_RAYS];
    let mut next = 0;
    for (place, &count) in places.iter_mut().zip(&tile.counts) {
        *place = next;
        next += count as usize;
    }
    let after = |i: usize| tile.rays[i].first + tile.counts[i];
    let last = (0..TILE_RAYS).map(after).max().unwrap_or(0);
    let mut at = [[[0.0; LANES]; 3]; TILE_RAYS];
    let mut lanes = [0; TILE_RAYS];
    let mut sampled = [Sampled::default(); TILE_RAYS];
    for first in (0..last).step_by(LANES) {
        let sample_of = |vector: usize, lane: usize| {
            let (group, quarter) = (vector / IN_VECTOR, vector % IN_VECTOR);
            let half = TILE / 2;
            let corner = group % half * 2 + group / half * 2 * TILE;
            let ray = corner + [0, 1, TILE, TILE + 1][lane / IN_VECTOR];
            (ray, first + (quarter * IN_VECTOR + lane % IN_VECTOR) as u32)
        };
        for vector in 0..TILE_RAYS {
            lanes[vector] = 0;
            for lane in 0..LANES {
                let (ray, k) = sample_of(vector, lane);
                let is_there = k >= tile.rays[ray].first && k < after(ray);
                lanes[vector] |= u16::from(is_there) << lane;
                let place = tile.rays[ray].at(k);
                (0..3).for_each(|axis| at[vector][axis][lane] = place[axis]);
            }
        }
        sampler.sample_all(Order::Compact, &at, &lanes, &mut sampled);
        for vector in 0..TILE_RAYS {
            let mut left = sampled[vector].valid & lanes[vector];
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let (ray, k) = sample_of(vector, lane);
                let k = k - tile.rays[ray].first;
                values[places[ray] + k as usize] = sampled[vector].values[lane];
            }
        }
    }
}

/// The reference encodings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    OsprayOne,
    OsprayTwo,
    UserGeometry,
    SharedFaces,
    TetMarch,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::OsprayOne,
        Self::OsprayTwo,
        Self::UserGeometry,
        Self::SharedFaces,
        Self::TetMarch,
    ];
    /// Those of Tables 4 and 6.
    pub const TABLE_6: [Self; 3] = [Self::UserGeometry, Self::SharedFaces, Self::TetMarch];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OsprayOne => "OSPRay 1.8.5",
            Self::OsprayTwo => "OSPRay 2.x (Open VKL)",
            Self::UserGeometry => "user geometry",
            Self::SharedFaces => "shared faces",
            Self::TetMarch => "tet marching",
        }
    }

    /// Bytes a cell that building takes at most, about.
    pub const fn build_bytes_per_cell(self) -> u64 {
        match self {
            Self::OsprayOne | Self::OsprayTwo | Self::UserGeometry => 600,
            Self::SharedFaces => 1200,
            Self::TetMarch => 300,
        }
    }

    /// Builds it.
    pub fn build(self, cells: &Cells) -> Result<Box<dyn Reference>, ReferenceError> {
        Ok(match self {
            Self::OsprayOne => Box::new(MinMaxBvh::new(cells)),
            Self::OsprayTwo => Box::new(LinkedBvh::new(cells)),
            Self::UserGeometry => Box::new(UserGeometry::new(cells)),
            Self::SharedFaces => Box::new(SharedFaces::new(cells)?),
            Self::TetMarch => Box::new(TetMarch::new(cells)?),
        })
    }
}

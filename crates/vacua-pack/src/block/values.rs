//! Values at sixteen places at once.
//!
//! In `f32`, of values as rendering sees them ([`WideMap`]): the first corner's plus weighted
//! differences to it, which keeps small signals on large offsets and constants exact, and never
//! outside the range of the corners' values, whatever the rounding.

use vacua_simd::{Float, Kernel, LANES, Level, Mask, Simd, Voxel, WideMap, dispatch, dispatch_at};
use vacua_volume::{Association, dispatch_scalar};

use super::{BlockLocator, Located, MAX_CORNERS, Places};
use crate::element::gradient_at;
use crate::field::PackedField;
use crate::packed::PackedMesh;

/// Gives the values of a field at sixteen places at once.
#[derive(Clone)]
pub struct BlockSampler<'a> {
    locator: BlockLocator<'a>,
    field: &'a PackedField,
    map: Option<WideMap>,
}

/// Values at sixteen places.
#[derive(Clone, Debug)]
pub struct Sampled {
    /// The values; 0 where there is none.
    pub values: [f32; LANES],
    /// The lanes that have one: those in a cell all of whose values are finite.
    pub valid: u16,
    /// The cells.
    pub located: Located,
}

impl<'a> BlockSampler<'a> {
    /// Prepares a field of a mesh. `map` says how stored values become those wanted.
    pub fn new(mesh: &'a PackedMesh, field: &'a PackedField, map: Option<WideMap>) -> Self {
        Self {
            locator: mesh.block_locator(),
            field,
            map,
        }
    }

    /// The locator.
    pub fn locator(&self) -> &BlockLocator<'a> {
        &self.locator
    }

    /// The values at the places of some lanes.
    pub fn sample(&self, at: &Places, lanes: u16) -> Sampled {
        dispatch(Sample {
            sampler: self,
            at,
            lanes,
        })
    }

    /// As [`Self::sample`] on a given instruction set; the same answer on each.
    pub fn sample_at(&self, level: Level, at: &Places, lanes: u16) -> Sampled {
        let sample = Sample {
            sampler: self,
            at,
            lanes,
        };
        dispatch_at(level, sample)
    }

    /// Values at the corners of the cells that were found, for fields on points; NaN where a file
    /// has none. Past the corners of a cell its first one's again.
    pub fn corner_values(&self, located: &Located) -> [[f32; LANES]; MAX_CORNERS] {
        let mut corners = [[0.0; LANES]; MAX_CORNERS];
        let values = self.field.values();
        dispatch_scalar!(values.scalar_type(), T => {
            let values: &[T] = bytemuck::cast_slice(values.bytes());
            self.fetch_corners(values, located, &mut corners);
        });
        corners
    }

    #[inline(always)]
    fn fetch_corners<T: Voxel>(
        &self,
        values: &[T],
        located: &Located,
        corners: &mut [[f32; LANES]; MAX_CORNERS],
    ) {
        let mut left = located.found;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            left &= left - 1;
            let submesh = located.submesh[lane] as usize;
            let Some(header) = self.locator.mesh.submeshes().get(submesh) else {
                continue;
            };
            let is_other = located.others >> lane & 1 == 1;
            for k in 0..MAX_CORNERS {
                if k >= 4 && !is_other {
                    corners[k][lane] = corners[0][lane];
                    continue;
                }
                let place = header
                    .first_vertex
                    .wrapping_add(u64::from(located.corners[k][lane]));
                let value = values.get(usize::try_from(place).unwrap_or(usize::MAX));
                corners[k][lane] = value.map_or(f32::NAN, |v| v.rendered(self.map));
            }
        }
    }

    /// Values of the cells that were found, for fields on cells; NaN where a file has none.
    fn cell_values(&self, located: &Located) -> [f32; LANES] {
        let mut found = [0.0; LANES];
        let values = self.field.values();
        dispatch_scalar!(values.scalar_type(), T => {
            let values: &[T] = bytemuck::cast_slice(values.bytes());
            let mut left = located.found;
            while left != 0 {
                let lane = left.trailing_zeros() as usize;
                left &= left - 1;
                let (submesh, node) = (located.submesh[lane] as usize, located.node[lane]);
                let cell = located.cell_in_node(self.locator.mesh, lane);
                let place = self.field.place_of_cell(self.locator.mesh, submesh, node, cell);
                let value = place.and_then(|place| values.get(place));
                found[lane] = value.map_or(f32::NAN, |v| v.rendered(self.map));
            }
        });
        found
    }

    /// Gradients of the values at the places that were found, axis by axis; 0 for fields on cells.
    pub fn gradients(&self, located: &Located) -> [[f32; LANES]; 3] {
        let mut gradients = [[0.0; LANES]; 3];
        if self.field.association() == Association::Cell {
            return gradients;
        }
        let values = self.corner_values(located);
        for lane in (0..LANES).filter(|lane| located.found >> lane & 1 == 1) {
            let mesh = self.locator.mesh;
            let Some(submesh) = mesh.submesh(located.submesh[lane] as usize) else {
                continue;
            };
            let cell_type = located.cell_type(lane);
            let mut corners = [[0.0; 3]; MAX_CORNERS];
            let mut corner_values = [0.0; MAX_CORNERS];
            let mut weights = [0.0; MAX_CORNERS];
            weights[0] = 1.0;
            for k in 0..cell_type.num_points() {
                let position = submesh.positions.get(located.corners[k][lane] as usize);
                corners[k] = position.copied().unwrap_or([f32::NAN; 3]);
                corner_values[k] = values[k][lane];
                if k > 0 {
                    weights[k] = f64::from(located.weights[k][lane]);
                    weights[0] -= weights[k];
                }
            }
            let gradient = gradient_at(cell_type, &corners, &corner_values, &weights);
            for axis in 0..3 {
                gradients[axis][lane] = gradient[axis] as f32;
            }
        }
        gradients
    }

    #[inline(always)]
    fn interpolate<S: Simd>(&self, located: &Located) -> (S::F, S::M) {
        let corners = self.corner_values(located);
        let first = S::F::from_array(corners[0]);
        let (mut lo, mut hi, mut value) = (first, first, first);
        let mut finite = first.abs().le(S::F::splat(f32::MAX));
        let others = S::M::from_bits(located.others);
        let num_corners = if located.others == 0 { 4 } else { MAX_CORNERS };
        for k in 1..num_corners {
            let corner = S::F::from_array(corners[k]);
            finite = finite & corner.abs().le(S::F::splat(f32::MAX));
            let mut weight = S::F::from_array(located.weights[k]);
            if k >= 4 {
                weight = weight.or_zero(others);
            }
            lo = lo.min(corner);
            hi = hi.max(corner);
            value = weight.mul_add(corner - first, value);
        }
        (value.max(lo).min(hi), finite)
    }
}

/// Values at sixteen places.
struct Sample<'a> {
    sampler: &'a BlockSampler<'a>,
    at: &'a Places,
    lanes: u16,
}

impl Kernel for Sample<'_> {
    type Output = Sampled;

    #[inline(always)]
    fn run<S: Simd>(self) -> Sampled {
        let mut located = Located::default();
        let sampler = self.sampler;
        sampler.locator.walk::<S>(self.at, self.lanes, &mut located);
        let (values, finite) = match sampler.field.association() {
            Association::Point => sampler.interpolate::<S>(&located),
            Association::Cell => {
                let values = S::F::from_array(sampler.cell_values(&located));
                (values, values.abs().le(S::F::splat(f32::MAX)))
            }
        };
        let valid = finite & S::M::from_bits(located.found);
        Sampled {
            values: values.or_zero(valid).to_array(),
            valid: valid.to_bits(),
            located,
        }
    }
}

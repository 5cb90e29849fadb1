//! Packed meshes at a level of detail: macrocells from the boxes of the level, and its sampler.

use rayon::prelude::*;
use vacua_pack::{DetailLevel, DetailSampler, Estimates, Places};
use vacua_simd::{Float, LANES, Mask, Simd, per_axis};
use vacua_skip::{Lattice, Macrocells};
use vacua_volume::ValueMap;

use super::{PackedCells, QUARTER, quarters};
use crate::blocks::Group;
use crate::error::RenderError;
use crate::sampler::Sampler;
use crate::setup::TILE_RAYS;

impl PackedCells {
    /// A sampler of the field's estimates.
    pub(crate) fn sampler_of(&self, level: DetailLevel, map: ValueMap) -> EstimateSampler<'_> {
        EstimateSampler {
            sampler: DetailSampler::new(self.mesh(), self.field(), level, map),
            cube: self.cube,
            corner: self.corner,
        }
    }

    /// Ranges of the estimates in each macrocell: those of the boxes that touch it contain the middle
    /// of any of them.
    pub(crate) fn macrocells_of(
        &self,
        level: DetailLevel,
        lattice: Lattice,
        map: ValueMap,
    ) -> Macrocells {
        let sampler = DetailSampler::new(self.mesh(), self.field(), level, map);
        let items: Vec<Vec<_>> = (0..self.mesh().submeshes().len())
            .into_par_iter()
            .map(|number| {
                let mut items = Vec::new();
                sampler.boxes(number, |[lo, hi], range| {
                    let bounds = [
                        [0, 1, 2].map(|a| self.ray_below(a, lo[a])),
                        [0, 1, 2].map(|a| self.ray_above(a, hi[a])),
                    ];
                    items.push((bounds, range));
                });
                items
            })
            .collect();
        Macrocells::of_boxes(lattice, items.into_iter().flatten())
    }

    /// A bound on the distance between estimate and exact value anywhere in the mesh, in units of the
    /// data: half the widest range of all boxes of the level that touch one cube of the lattice.
    ///
    /// # Errors
    /// [`RenderError::Lattice`] if the mesh is too long.
    pub(crate) fn largest_bound(
        &self,
        level: DetailLevel,
        map: ValueMap,
    ) -> Result<f64, RenderError> {
        let macrocells = self.macrocells_of(level, self.lattice()?, map);
        let ranges = (0..macrocells.lattice().len()).filter_map(|i| macrocells.range(i));
        // Ends were rounded to `f32`.
        let width = |lo: f32, hi: f32| f64::from(hi.next_up()) - f64::from(lo.next_down());
        let widest = ranges.map(|(lo, hi)| width(lo, hi));
        Ok(0.5 * widest.fold(0.0, f64::max) / map.factor)
    }
}

/// The place of a vector among those of a tile: sixteen that follow each other are samples of all of its
/// rays, a quarter of the depth.
fn among_sixteen(vector: usize) -> usize {
    vector % 4 * (TILE_RAYS / 4) + vector / 4
}

/// Estimates of the values of a packed mesh.
pub(crate) struct EstimateSampler<'a> {
    sampler: DetailSampler<'a>,
    cube: f32,
    corner: [f32; 3],
}

impl EstimateSampler<'_> {
    /// Places of the mesh: those of exact sampling.
    #[inline(always)]
    fn places<S: Simd>(&self, at: [S::F; 3]) -> Places {
        let cube = S::F::splat(self.cube);
        per_axis!(a => at[a].mul_add(cube, S::F::splat(self.corner[a])).to_array())
    }
}

impl Sampler for EstimateSampler<'_> {
    type Place = ();
    const IS_TOGETHER: bool = true;

    #[inline(always)]
    fn sample<S: Simd>(&self, at: [S::F; 3], lanes: S::M) -> (S::F, S::M, ()) {
        let mut found = [Estimates::default()];
        let places = [self.places::<S>(at)];
        self.sampler
            .sample_all(&places, &[lanes.to_bits()], &mut found);
        let [Estimates { values, valid }] = found;
        (S::F::from_array(values), S::M::from_bits(valid), ())
    }

    #[inline(always)]
    fn sample_tile<S: Simd>(&self, places: &[(usize, [S::F; 3])], group: &mut Group<S, ()>) {
        let mut at = [[[0.0; LANES]; 3]; TILE_RAYS];
        let mut lanes = [0u16; TILE_RAYS];
        for (n, &(ray, place)) in places.iter().enumerate() {
            let place = self.places::<S>(place);
            let bits = group.lanes[n].to_bits();
            for (q, (vector, from)) in quarters(ray).into_iter().enumerate() {
                let vector = among_sixteen(vector);
                for axis in 0..3 {
                    let samples = &place[axis][q * QUARTER..][..QUARTER];
                    at[vector][axis][from..][..QUARTER].copy_from_slice(samples);
                }
                lanes[vector] |= (bits >> (q * QUARTER) & 0xF) << from;
            }
        }
        let mut found = [Estimates::default(); TILE_RAYS];
        self.sampler.sample_all(&at, &lanes, &mut found);
        for (n, &(ray, _)) in places.iter().enumerate() {
            let mut value = [0.0; LANES];
            let mut valid = 0;
            for (q, (vector, from)) in quarters(ray).into_iter().enumerate() {
                let vector = among_sixteen(vector);
                let (to, found) = (q * QUARTER, &found[vector]);
                value[to..][..QUARTER].copy_from_slice(&found.values[from..][..QUARTER]);
                valid |= (found.valid >> from & 0xF) << to;
            }
            group.value[n] = S::F::from_array(value);
            group.seen[n] = S::M::from_bits(valid);
        }
    }

    /// What stands for many values is constant around a place.
    #[inline(always)]
    fn gradient<S: Simd>(&self, _: [S::F; 3], (): &()) -> [S::F; 3] {
        [S::F::splat(0.0); 3]
    }
}

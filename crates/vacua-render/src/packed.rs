//! Packed meshes in the renderer, unstructured ones and curvilinear grids: their ray space, strides,
//! macrocells and sampler.
//!
//! Ray space is the mesh's own space, moved to its lower corner and scaled, so that its unit cubes hold a
//! few cells each; the cubes are what macrocells and strides are made of. A
//! place in ray space becomes one of the mesh by one fused multiplication and addition, rounded
//! once: that is where the sample is.

mod detail;

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicU32, AtomicU64};

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;
use vacua_pack::{
    BlockSampler, EncodeOptions, Located, Order, PackedField, PackedMesh, PackedVolume, Places,
    Sampled, Submesh, encode,
};
use vacua_simd::{Float, LANES, Mask, Simd, WideMap, per_axis};
use vacua_skip::{Axis, Lattice, Macrocells};
use vacua_volume::{CellType, Geometry, UnstructuredMesh, ValueMap, Volume};

use crate::blocks::{Group, LatticeMinima, Strides};
use crate::data::SceneData;
use crate::error::RenderError;
use crate::sampler::Sampler;
use crate::setup::{TILE, TILE_RAYS};
use crate::space::RaySpace;

/// Cells in a cube of the lattice, at least, were they all alike: a byte a cell for strides at most.
const CELLS_PER_CUBE: f64 = 4.0;
/// Most cubes along an axis.
const MAX_CUBES: f64 = 1024.0;
/// Cubes a side that are taken together for the smallest cell size there is.
const POOL: usize = 4;
/// Sizes of cells are summed in steps of this part of a cube's side.
const SIZE_STEPS: f64 = (1u64 << 24) as f64;
/// The smallest cell size that sampling follows is the lattice's diagonal over this.
const MAX_RESOLUTION: f64 = (1 << 20) as f64;

/// A box in ray space, and the range of the values in it.
type Item = ([[f32; 3]; 2], [f32; 2]);

/// A mesh with a field, encoded, ready to be sampled.
pub struct PackedCells {
    /// Its ray space.
    pub space: RaySpace,
    pub(crate) strides: Strides,
    volume: Arc<PackedVolume>,
    /// Side of a lattice cube.
    cube: f32,
    /// Lower corner of the lattice, relative to the mesh's origin.
    corner: [f32; 3],
}

impl std::fmt::Debug for PackedCells {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PackedCells")
            .field("cells", &self.mesh().num_cells())
            .field("cube", &self.cube)
            .finish_non_exhaustive()
    }
}

/// The mesh that the cells of a volume are; `None` if they lie between axis-aligned planes.
pub(crate) fn mesh_of(volume: &Volume) -> Option<UnstructuredMesh> {
    match &**volume.geometry() {
        Geometry::Uniform(_) | Geometry::Rectilinear(_) => None,
        Geometry::Curvilinear(grid) => {
            let blanked_cells = volume.blanked_cells();
            Some(UnstructuredMesh::of_curvilinear(grid, blanked_cells))
        }
        Geometry::Unstructured(mesh) => Some(mesh.clone()),
    }
}

/// Encodes a mesh and the scalars of a volume.
///
/// # Errors
/// [`RenderError::Encode`] or [`RenderError::Field`] if it cannot be encoded.
fn encoded(mesh: &UnstructuredMesh, volume: &Volume) -> Result<Arc<PackedVolume>, RenderError> {
    let encoded = encode(mesh, EncodeOptions::default())?;
    let field = PackedField::pack(
        &encoded.mesh,
        &encoded.map,
        volume.name(),
        volume.association(),
        volume.scalars(),
    )?;
    Ok(Arc::new(PackedVolume::new(encoded.mesh, field)))
}

impl PackedCells {
    /// The cells of a scene's data, if they lie otherwise than between axis-aligned planes; encoded here
    /// unless they are already.
    ///
    /// # Errors
    /// [`RenderError::NoPositions`] if no point is anywhere, [`RenderError::Encode`] or
    /// [`RenderError::Field`] if it cannot be encoded.
    pub fn of_data(data: &SceneData) -> Result<Option<Self>, RenderError> {
        let volume = match data {
            SceneData::Packed(volume) => volume.clone(),
            SceneData::Volume(volume) => match mesh_of(volume) {
                Some(mesh) => {
                    let encoded = encoded(&mesh, volume)?;
                    if encoded.mesh().num_cells() == 0 && mesh.bounds().is_none() {
                        return Err(RenderError::NoPositions);
                    }
                    encoded
                }
                None => return Ok(None),
            },
        };
        Self::new(volume).map(Some)
    }

    /// The field.
    pub fn field(&self) -> &PackedField {
        self.volume.field()
    }

    /// Side of a unit cube of ray space in the mesh's own space.
    pub fn cube(&self) -> f32 {
        self.cube
    }

    /// Lower corner of ray space, relative to the mesh's origin.
    pub fn corner(&self) -> [f32; 3] {
        self.corner
    }

    /// The smallest cells within boxes of ray space, if cells differ in size.
    pub fn minima(&self) -> Option<&LatticeMinima> {
        match &self.strides {
            Strides::Lattice(minima) => Some(minima),
            Strides::Constant | Strides::Varying(_) => None,
        }
    }

    /// Prepares an encoded mesh.
    ///
    /// # Errors
    /// [`RenderError::Lattice`] if it has too many cubes.
    pub fn new(volume: Arc<PackedVolume>) -> Result<Self, RenderError> {
        let mesh = volume.mesh();
        let headers = mesh.submeshes();
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for header in headers {
            for a in 0..3 {
                lo[a] = lo[a].min(header.lo[a]);
                hi[a] = hi[a].max(header.hi[a]);
            }
        }
        let (lower, upper) = (
            DVec3::from(lo.map(f64::from)),
            DVec3::from(hi.map(f64::from)),
        );
        // Without a cell there is nothing to see, at one place as at any other.
        let somewhere = lower.is_finite() && upper.is_finite();
        let (lower, upper) = if somewhere {
            (lower, upper)
        } else {
            (DVec3::ZERO, DVec3::ZERO)
        };
        let cube = cube_size(upper - lower, mesh.num_cells() as f64);
        let counts = (upper - lower) / f64::from(cube);
        let axes = counts.to_array().map(|n| Axis::Unit {
            cells: (n.ceil() as usize).max(1),
        });
        let origin = DVec3::from(mesh.origin()) + lower;
        let side = f64::from(cube);
        let matrix = DMat3::from_diagonal(DVec3::splat(side.recip()));
        let mut cells = Self {
            space: RaySpace {
                ray_from_world: DAffine3::from_mat3_translation(matrix, -origin / side),
                axes,
                finest: DVec3::ONE,
            },
            strides: Strides::Constant,
            volume,
            cube,
            corner: lower.as_vec3().to_array(),
        };
        let (finest, strides) = cells.sizes()?;
        cells.space.finest = DVec3::splat(finest);
        cells.strides = strides;
        Ok(cells)
    }

    /// The mesh.
    pub fn mesh(&self) -> &PackedMesh {
        self.volume.mesh()
    }

    /// The lattice of cubes.
    fn lattice(&self) -> Result<Lattice, RenderError> {
        Ok(Lattice::new(self.space.axes.clone(), 1)?)
    }

    /// The smallest size of cells anywhere, in ray space, and strides from those everywhere: the
    /// mean of the cells around, which slivers change little.
    fn sizes(&self) -> Result<(f64, Strides), RenderError> {
        let lattice = self.lattice()?;
        let counts = lattice.counts();
        // In parallel, as all that goes through so many cubes: memory is handed out by the thread that
        // touches it first.
        let sums: Vec<(AtomicU64, AtomicU32)> = (0..lattice.len())
            .into_par_iter()
            .map(|_| Default::default())
            .collect();
        (0..self.mesh().submeshes().len())
            .into_par_iter()
            .filter_map(|s| self.mesh().submesh(s))
            .for_each(|submesh| {
                self.sizes_in(&submesh, &lattice, |cube, sum, count| {
                    // Whole numbers, so that no order of the cells, which variants and threads differ
                    // in, changes a sum.
                    let add = |s: u64| Some(s.saturating_add(sum));
                    let _ = sums[cube].0.fetch_update(Relaxed, Relaxed, add);
                    sums[cube].1.fetch_add(count, Relaxed);
                });
            });
        let sums: Vec<(f64, u32)> = sums
            .into_par_iter()
            .map(|(sum, count)| (sum.into_inner() as f64 / SIZE_STEPS, count.into_inner()))
            .collect();
        let pools = counts.map(|n| n.div_ceil(POOL));
        let mut pooled = vec![(0.0f64, 0u64); pools.iter().product()];
        // Layers of pools, each of which sums its cubes in order.
        let layer = counts[0] * counts[1];
        pooled
            .par_chunks_mut(pools[0] * pools[1])
            .zip(sums.par_chunks(layer * POOL))
            .for_each(|(pooled, sums)| {
                for (row, sums) in sums.chunks(counts[0]).enumerate() {
                    let first = pools[0] * (row % counts[1] / POOL);
                    for (pool, sums) in pooled[first..].iter_mut().zip(sums.chunks(POOL)) {
                        for &(sum, count) in sums {
                            *pool = (pool.0 + sum, pool.1 + u64::from(count));
                        }
                    }
                }
            });
        let means = pooled.iter().filter(|pool| pool.1 > 0);
        let smallest = means
            .map(|pool| pool.0 / pool.1 as f64)
            .fold(f64::INFINITY, f64::min);
        let diagonal = DVec3::from(counts.map(|n| n as f64)).length();
        let finest = smallest.clamp(diagonal / MAX_RESOLUTION, diagonal);
        let ratio = |&(sum, count): &(f64, u32)| match count {
            0 => f32::INFINITY,
            _ => (sum / f64::from(count) / finest).max(1.0) as f32,
        };
        let ratios: Vec<f32> = sums.par_iter().map(ratio).collect();
        // Strides are powers of two: unless some cells are twice as large, there is but one.
        let varies = ratios.par_iter().any(|&r| r >= 2.0 && r.is_finite());
        let strides = if varies {
            Strides::Lattice(LatticeMinima::new(counts, ratios))
        } else {
            Strides::Constant
        };
        Ok((finest, strides))
    }

    /// Calls `add` with the sizes of a sub-mesh's cells, in steps, and their number, each in the cube of
    /// its middle; those of neighbours in a cube come together.
    fn sizes_in(&self, submesh: &Submesh, lattice: &Lattice, add: impl Fn(usize, u64, u32)) {
        let [nx, ny, _] = lattice.counts();
        let mut last = (0, 0u64, 0);
        for node in 0..submesh.header.num_nodes {
            submesh.cells_of_node(node, |_, cell_type, corners| {
                let mut positions = [DVec3::ZERO; 8];
                let mut middle = DVec3::ZERO;
                let n = cell_type.num_points();
                // Times a power of two is as exact as by one, and faster.
                let is_exact = n.is_power_of_two();
                let part = (n as f64).recip();
                for k in 0..n {
                    let position = submesh.position(corners[k]);
                    positions[k] = position.map_or(DVec3::NAN, |p| DVec3::from(p.map(f64::from)));
                    middle += if is_exact {
                        positions[k] * part
                    } else {
                        positions[k] / n as f64
                    };
                }
                let size = cell_size(cell_type, &positions) / f64::from(self.cube);
                let middle =
                    (middle - DVec3::from(self.corner.map(f64::from))) / f64::from(self.cube);
                if size > 0.0 && size.is_finite() && middle.is_finite() {
                    let at = [0, 1, 2].map(|a| lattice.macrocell_of(a, middle[a] as f32));
                    let cube = at[0] + nx * (at[1] + ny * at[2]);
                    let steps = (f64::from(size as f32) * SIZE_STEPS) as u64;
                    if cube != last.0 {
                        add(last.0, last.1, last.2);
                        last = (cube, 0, 0);
                    }
                    last = (cube, last.1.saturating_add(steps), last.2 + 1);
                }
            });
        }
        add(last.0, last.1, last.2);
    }

    /// Ranges of the values that sampling can compute in each macrocell, from those of leaves.
    pub fn macrocells(&self, lattice: Lattice, map: ValueMap) -> Macrocells {
        let items: Vec<Vec<_>> = (0..self.mesh().submeshes().len())
            .into_par_iter()
            .map(|s| in_macrocells(&lattice, &self.leaf_boxes(s, map)))
            .collect();
        Macrocells::of_boxes(lattice, items.into_iter().flatten())
    }

    /// Boxes in ray space, widened, and ranges of the leaves of a sub-mesh.
    fn leaf_boxes(&self, number: usize, map: ValueMap) -> Vec<Item> {
        let mut items = Vec::new();
        let field = self.volume.field();
        field.leaf_ranges(self.mesh(), number, |[lo, hi], range| {
            // A cell accepts no place outside the box around its own corners.
            let bounds = [
                [0, 1, 2].map(|a| self.ray_below(a, lo[a])),
                [0, 1, 2].map(|a| self.ray_above(a, hi[a])),
            ];
            items.push((bounds, [map.rendered(range.lo), map.rendered(range.hi)]));
        });
        items
    }

    /// A ray-space coordinate below all that become `local` or more when they are rounded.
    fn ray_below(&self, axis: usize, local: f64) -> f32 {
        let corner = f64::from(self.corner[axis]);
        let slack = local.abs().max(corner.abs()) * f64::from(f32::EPSILON);
        (((local - slack - corner) / f64::from(self.cube)) as f32).next_down()
    }

    /// A ray-space coordinate above all that become `local` or less when they are rounded.
    fn ray_above(&self, axis: usize, local: f64) -> f32 {
        let corner = f64::from(self.corner[axis]);
        let slack = local.abs().max(corner.abs()) * f64::from(f32::EPSILON);
        (((local + slack - corner) / f64::from(self.cube)) as f32).next_up()
    }

    /// A sampler of the field.
    pub(crate) fn sampler(&self, map: Option<WideMap>) -> PackedSampler<'_> {
        PackedSampler {
            sampler: BlockSampler::new(self.mesh(), self.volume.field(), map),
            cube: self.cube,
            corner: self.corner,
        }
    }
}

/// The ranges of some items that lie close together, joined by macrocell: an item for each that they
/// touch, in its middle.
fn in_macrocells(lattice: &Lattice, items: &[Item]) -> Vec<Item> {
    let index = |at: [f32; 3]| [0, 1, 2].map(|a| lattice.macrocell_of(a, at[a]));
    let (mut from, mut to) = ([usize::MAX; 3], [0; 3]);
    let touched = items.iter().map(|([lo, hi], _)| (index(*lo), index(*hi)));
    let touched: Vec<([usize; 3], [usize; 3])> = touched.collect();
    for (lo, hi) in &touched {
        for a in 0..3 {
            from[a] = from[a].min(lo[a]);
            to[a] = to[a].max(hi[a] + 1);
        }
    }
    let [nx, ny, nz] = [0, 1, 2].map(|a| to[a].saturating_sub(from[a]));
    let mut ranges = vec![[f32::INFINITY, f32::NEG_INFINITY]; nx * ny * nz];
    for ((lo, hi), (_, range)) in touched.iter().zip(items) {
        for z in lo[2]..=hi[2] {
            for y in lo[1]..=hi[1] {
                for x in lo[0]..=hi[0] {
                    let row = (y - from[1]) + ny * (z - from[2]);
                    let joined = &mut ranges[(x - from[0]) + nx * row];
                    *joined = [joined[0].min(range[0]), joined[1].max(range[1])];
                }
            }
        }
    }
    let side = lattice.side();
    let item = |(i, &range): (usize, &[f32; 2])| {
        let at = [i % nx, i / nx % ny, i / nx / ny];
        let middle = [0, 1, 2].map(|a| ((from[a] + at[a]) * side) as f32 + 0.5);
        ([middle; 2], range)
    };
    let all = ranges.iter().enumerate();
    all.filter(|(_, range)| range[0] <= range[1])
        .map(item)
        .collect()
}

/// Side of a lattice cube: as small as leaves enough cells to a cube, and not too many cubes along an
/// axis. A part of the largest side, whatever its unit: the same mesh in metres and in nanometres has
/// the same cubes.
fn cube_size(size: DVec3, num_cells: f64) -> f32 {
    let largest = size.max_element();
    if largest <= 0.0 {
        return 1.0;
    }
    // A little more, so that rounding adds no cube.
    let mut cube = (largest / MAX_CUBES * (1.0 + f64::from(f32::EPSILON))) as f32;
    cube = cube.max(f32::MIN_POSITIVE);
    let cubes = |cube: f32| {
        let counts = (size / f64::from(cube)).ceil().max(DVec3::ONE);
        counts.element_product()
    };
    while f64::from(cube) < largest && cubes(cube) > (num_cells / CELLS_PER_CUBE).max(1.0) {
        cube *= 2.0;
    }
    cube
}

/// How far across a cell is, in its shortest direction; 1 for what cubes of side 1 are cut into.
fn cell_size(cell_type: CellType, p: &[DVec3; 8]) -> f64 {
    let edge = |a: usize, b: usize| (p[a] - p[b]).length();
    match cell_type {
        CellType::Tetrahedron => {
            let (a, b, c) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
            let volume = a.dot(b.cross(c)).abs();
            let faces = [a.cross(b), b.cross(c), c.cross(a), (b - a).cross(c - a)];
            let largest = faces.iter().fold(0.0, |m, f| f64::max(m, f.length()));
            // The least height, which is half the diagonal of a face of the cube.
            std::f64::consts::SQRT_2 * volume / largest
        }
        CellType::Pyramid => {
            let along = (edge(0, 1) + edge(2, 3)) / 2.0;
            let across = (edge(1, 2) + edge(3, 0)) / 2.0;
            let up = (0..4).map(|k| edge(k, 4)).sum::<f64>() / 4.0;
            along.min(across).min(up)
        }
        CellType::Wedge => {
            let around = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3)];
            let around = around.iter().map(|&(a, b)| edge(a, b)).sum::<f64>() / 6.0;
            let up = (edge(0, 3) + edge(1, 4) + edge(2, 5)) / 3.0;
            around.min(up)
        }
        CellType::Hexahedron => {
            let along = edge(0, 1) + edge(3, 2) + edge(4, 5) + edge(7, 6);
            let across = edge(0, 3) + edge(1, 2) + edge(4, 7) + edge(5, 6);
            let up = edge(0, 4) + edge(1, 5) + edge(2, 6) + edge(3, 7);
            along.min(across).min(up) / 4.0
        }
    }
}

/// Values and gradients of a packed mesh.
pub(crate) struct PackedSampler<'a> {
    sampler: BlockSampler<'a>,
    cube: f32,
    corner: [f32; 3],
}

/// Samples of a ray that lie side by side in a vector of the mesh's sampler, which has so many of
/// each of so many rays: places of a vector are close together along the rays and across.
const QUARTER: usize = LANES / 4;

/// Quarters of vectors: those of the samples of a ray go to different vectors, next to those of its
/// neighbours. The first samples of all rays come first: sixteen vectors in a row, which are tried
/// on a box together, then lie about as close together along the rays as across.
fn quarters(ray: usize) -> [(usize, usize); 4] {
    let (x, y) = (ray % TILE, ray / TILE);
    let (quad, corner) = (y / 2 * (TILE / 2) + x / 2, y % 2 * 2 + x % 2);
    [0, 1, 2, 3].map(|quarter| (TILE_RAYS / 4 * quarter + quad, corner * QUARTER))
}

impl PackedSampler<'_> {
    /// Places of the mesh.
    #[inline(always)]
    fn places<S: Simd>(&self, at: [S::F; 3]) -> Places {
        let cube = S::F::splat(self.cube);
        per_axis!(a => at[a].mul_add(cube, S::F::splat(self.corner[a])).to_array())
    }
}

impl Sampler for PackedSampler<'_> {
    type Place = Located;
    const IS_TOGETHER: bool = true;

    #[inline(always)]
    fn sample<S: Simd>(&self, at: [S::F; 3], lanes: S::M) -> (S::F, S::M, Located) {
        let sampled = self.sampler.sample(&self.places::<S>(at), lanes.to_bits());
        (
            S::F::from_array(sampled.values),
            S::M::from_bits(sampled.valid),
            sampled.located,
        )
    }

    #[inline(always)]
    fn sample_tile<S: Simd>(&self, places: &[(usize, [S::F; 3])], group: &mut Group<S, Located>) {
        let mut at = [[[0.0; LANES]; 3]; TILE_RAYS];
        let mut lanes = [0u16; TILE_RAYS];
        for (n, &(ray, place)) in places.iter().enumerate() {
            let place = self.places::<S>(place);
            let bits = group.lanes[n].to_bits();
            for (q, (vector, from)) in quarters(ray).into_iter().enumerate() {
                for axis in 0..3 {
                    let samples = &place[axis][q * QUARTER..][..QUARTER];
                    at[vector][axis][from..][..QUARTER].copy_from_slice(samples);
                }
                lanes[vector] |= (bits >> (q * QUARTER) & 0xF) << from;
            }
        }
        let mut sampled = [Sampled::default(); TILE_RAYS];
        self.sampler
            .sample_all(Order::Compact, &at, &lanes, &mut sampled);
        for (n, &(ray, _)) in places.iter().enumerate() {
            let mut value = [0.0; LANES];
            let mut valid = 0;
            let place = &mut group.place[n];
            (place.found, place.others) = (0, 0);
            for (q, (vector, from)) in quarters(ray).into_iter().enumerate() {
                let (to, sampled) = (q * QUARTER, &sampled[vector]);
                let located = &sampled.located;
                value[to..][..QUARTER].copy_from_slice(&sampled.values[from..][..QUARTER]);
                valid |= (sampled.valid >> from & 0xF) << to;
                place.found |= (located.found >> from & 0xF) << to;
                place.others |= (located.others >> from & 0xF) << to;
                place.submesh[to..][..QUARTER].copy_from_slice(&located.submesh[from..][..QUARTER]);
                place.primitive[to..][..QUARTER]
                    .copy_from_slice(&located.primitive[from..][..QUARTER]);
            }
            group.value[n] = S::F::from_array(value);
            group.seen[n] = S::M::from_bits(valid);
        }
    }

    #[inline(always)]
    fn gradient<S: Simd>(&self, at: [S::F; 3], place: &Located) -> [S::F; 3] {
        let gradients = self.sampler.gradients(&self.places::<S>(at), place);
        let cube = S::F::splat(self.cube);
        per_axis!(a => S::F::from_array(gradients[a]) * cube)
    }
}

//! The triangulated boundary between active and inactive macrocells (paper A §4.2.2, Listing 1).
//!
//! Every face between an active macrocell and an inactive one, or the outside, gives a quad of two
//! triangles, wound counter-clockwise seen from the inactive side. Words of the mask are compared
//! at once, a slab of macrocells a task; slabs are joined in order, so that the result does not
//! depend on threads. Deviation: Listing 1 runs over as many faces as there are cells and leaves out
//! the guards for indices outside; here there are M + 1 faces along each axis, and outside counts
//! as inactive.

use rayon::prelude::*;

use crate::lattice::Lattice;
use crate::mask::ActiveMask;

/// One face of the boundary: perpendicular to `axis`, spanned along `(axis + 1) % 3` and
/// `(axis + 2) % 3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quad {
    /// 0, 1 or 2.
    pub axis: u8,
    /// Whether the active macrocell lies below the plane, so that the face looks up the axis.
    pub faces_up: bool,
    /// Macrocell plane along the axis.
    pub plane: u32,
    /// Macrocell along `(axis + 1) % 3` and `(axis + 2) % 3`.
    pub at: [u32; 2],
}

/// Most triangles that the boundary of any mask over so many macrocells can have: two for every
/// face of the lattice.
pub fn boundary_triangle_bound([x, y, z]: [usize; 3]) -> usize {
    2 * ((x + 1) * y * z + x * (y + 1) * z + x * y * (z + 1))
}

/// The boundary of an active mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BoundaryMesh {
    counts: [usize; 3],
    quads: Vec<Quad>,
}

impl BoundaryMesh {
    /// Extracts the boundary: first all faces across x, then y, then z.
    pub fn new(mask: &ActiveMask) -> Self {
        let counts = mask.counts();
        // Faces across x and y stay within a slab of macrocells; those across z have one plane more.
        let slabs = [counts[2], counts[2], counts[2] + 1];
        let tasks: Vec<(usize, usize)> = (0..3)
            .flat_map(|axis| (0..slabs[axis]).map(move |z| (axis, z)))
            .collect();
        let quads = tasks
            .into_par_iter()
            .with_min_len(4)
            .flat_map_iter(|(axis, z)| {
                let mut quads = Vec::new();
                match axis {
                    0 => faces_across_x(mask, z, &mut quads),
                    1 => faces_across_y(mask, z, &mut quads),
                    _ => faces_across_z(mask, z, &mut quads),
                }
                quads
            })
            .collect();
        Self { counts, quads }
    }

    /// Macrocells along each axis of the mask it bounds.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// The faces.
    pub fn quads(&self) -> &[Quad] {
        &self.quads
    }

    /// Two a face.
    pub fn num_triangles(&self) -> usize {
        2 * self.quads.len()
    }

    /// Triangles as indices into [`BoundaryMesh::vertices`].
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        let corners = self.counts.map(|n| n as u32 + 1);
        let vertex = |quad: &Quad, u: u32, v: u32| {
            let axis = usize::from(quad.axis);
            let mut p = [0; 3];
            p[axis] = quad.plane;
            p[(axis + 1) % 3] = quad.at[0] + u;
            p[(axis + 2) % 3] = quad.at[1] + v;
            p[0] + corners[0] * (p[1] + corners[1] * p[2])
        };
        self.quads
            .iter()
            .flat_map(|quad| {
                let [a, b, c, d] =
                    [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(u, v)| vertex(quad, u, v));
                if quad.faces_up {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[b, a, c], [c, a, d]]
                }
            })
            .collect()
    }

    /// All lattice points of the macrocells in ray space, used or not (paper A §4.1.2).
    pub fn vertices(&self, lattice: &Lattice) -> Vec<[f32; 3]> {
        let [nx, ny, nz] = self.counts;
        (0..=nz)
            .flat_map(|z| (0..=ny).flat_map(move |y| (0..=nx).map(move |x| [x, y, z])))
            .map(|p| [0, 1, 2].map(|a| lattice.plane(a, p[a])))
            .collect()
    }
}

/// Row of words at (y, z); `None` outside.
fn row(mask: &ActiveMask, y: Option<usize>, z: Option<usize>) -> Option<&[u32]> {
    let [_, cy, cz] = mask.counts();
    let (y, z) = (y.filter(|&y| y < cy)?, z.filter(|&z| z < cz)?);
    Some(&mask.words()[mask.row_words() * (y + cy * z)..][..mask.row_words()])
}

fn faces_across_x(mask: &ActiveMask, z: usize, quads: &mut Vec<Quad>) {
    let [cx, cy, _] = mask.counts();
    for y in 0..cy {
        let Some(words) = row(mask, Some(y), Some(z)) else {
            continue;
        };
        let mut before = 0;
        // One word more than there are, for the plane behind the last macrocell.
        for w in 0..=cx / 32 {
            let word = words.get(w).copied().unwrap_or(0);
            let below = word << 1 | before;
            before = word >> 31;
            for x in bits(word ^ below) {
                quads.push(Quad {
                    axis: 0,
                    faces_up: below >> x & 1 == 1,
                    plane: 32 * w as u32 + x,
                    at: [y as u32, z as u32],
                });
            }
        }
    }
}

fn faces_across_y(mask: &ActiveMask, z: usize, quads: &mut Vec<Quad>) {
    for y in 0..=mask.counts()[1] {
        let (below, above) = (
            row(mask, y.checked_sub(1), Some(z)),
            row(mask, Some(y), Some(z)),
        );
        faces_between(mask, below, above, |x, faces_up| {
            quads.push(Quad {
                axis: 1,
                faces_up,
                plane: y as u32,
                at: [z as u32, x],
            });
        });
    }
}

fn faces_across_z(mask: &ActiveMask, z: usize, quads: &mut Vec<Quad>) {
    for y in 0..mask.counts()[1] {
        let (below, above) = (
            row(mask, Some(y), z.checked_sub(1)),
            row(mask, Some(y), Some(z)),
        );
        faces_between(mask, below, above, |x, faces_up| {
            quads.push(Quad {
                axis: 2,
                faces_up,
                plane: z as u32,
                at: [x, y as u32],
            });
        });
    }
}

/// Calls `emit` for every x at which two rows differ.
fn faces_between(
    mask: &ActiveMask,
    below: Option<&[u32]>,
    above: Option<&[u32]>,
    mut emit: impl FnMut(u32, bool),
) {
    for w in 0..mask.row_words() {
        let below = below.map_or(0, |r| r[w]);
        let above = above.map_or(0, |r| r[w]);
        for x in bits(below ^ above) {
            emit(32 * w as u32 + x, below >> x & 1 == 1);
        }
    }
}

/// Positions of the set bits, lowest first.
fn bits(mut word: u32) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        (word != 0).then(|| {
            let bit = word.trailing_zeros();
            word &= word - 1;
            bit
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::Axis;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        #[test]
        fn the_boundary_encloses_the_active_macrocells(
            counts in prop::array::uniform3(1usize..40),
            seed in any::<u64>(),
            density in 0u64..=8,
        ) {
            let counts = [counts[0] * 2, counts[1].min(6), counts[2].min(6)];
            let mut mask = ActiveMask::inactive(counts);
            for z in 0..counts[2] { for y in 0..counts[1] { for x in 0..counts[0] {
                let i = (x + counts[0] * (y + counts[1] * z)) as u64;
                let h = (i ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 61;
                mask.set([x, y, z], h < density);
            }}}
            let mesh = BoundaryMesh::new(&mask);
            let lattice = Lattice::new(counts.map(|cells| Axis::Unit { cells }), 1).expect("cells");
            let (vertices, triangles) = (mesh.vertices(&lattice), mesh.triangles());
            prop_assert_eq!(triangles.len(), mesh.num_triangles());
            prop_assert!(triangles.len() <= boundary_triangle_bound(counts));
            let mut six_volumes = 0.0f64;
            let mut edges: HashMap<(u32, u32), (u32, i32)> = HashMap::new();
            for t in &triangles {
                let [a, b, c] = t.map(|i| vertices[i as usize].map(f64::from));
                six_volumes += a[0] * (b[1] * c[2] - b[2] * c[1])
                    + a[1] * (b[2] * c[0] - b[0] * c[2])
                    + a[2] * (b[0] * c[1] - b[1] * c[0]);
                for (p, q) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                    let edge = edges.entry((p.min(q), p.max(q))).or_default();
                    edge.0 += 1;
                    edge.1 += if p < q { 1 } else { -1 };
                }
            }
            prop_assert_eq!(six_volumes / 6.0, mask.num_active() as f64);
            for (count, direction) in edges.values() {
                prop_assert_eq!(count % 2, 0, "edges are shared evenly");
                prop_assert_eq!(*direction, 0, "and run both ways");
            }
        }
    }
}

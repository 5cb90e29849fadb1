//! Coplanar faces of the boundary mesh merged into rectangles: what a hierarchy is built over, as it
//! takes a fraction of the time that it takes over the faces themselves.
//!
//! Greedy, in the order of the faces: first runs along one axis of each plane, then equal runs of
//! neighbouring rows. The paper's counts are those of the unmerged mesh.

use crate::boundary::{BoundaryMesh, Quad};

/// Faces of one plane that look the same way: macrocells `lo .. hi` along `(axis + 1) % 3` and
/// `(axis + 2) % 3`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rectangle {
    pub axis: u8,
    pub faces_up: bool,
    pub plane: u32,
    pub lo: [u32; 2],
    pub hi: [u32; 2],
}

impl Rectangle {
    fn of(quad: &Quad) -> Self {
        Self {
            axis: quad.axis,
            faces_up: quad.faces_up,
            plane: quad.plane,
            lo: quad.at,
            hi: quad.at.map(|i| i + 1),
        }
    }
}

/// Which of the two sides the first runs go along, by axis: y, x and x.
const RUN_SIDE: [usize; 3] = [0, 1, 0];

/// No rectangle yet.
const NONE: u32 = u32::MAX;

/// Covers the faces of a boundary with rectangles, each face once.
pub(crate) fn merged(mesh: &BoundaryMesh) -> Vec<Rectangle> {
    let mut rectangles = Vec::new();
    let counts = mesh.counts().map(|n| n as u32);
    let mut rest = mesh.quads();
    for axis in 0..3 {
        let end = rest.partition_point(|q| q.axis <= axis);
        let (here, after) = rest.split_at(end);
        rest = after;
        let runs = runs(here, counts[usize::from(axis)] + 1);
        stack(&runs, counts, &mut rectangles);
    }
    rectangles
}

/// Joins neighbouring faces along the run side.
fn runs(quads: &[Quad], planes: u32) -> Vec<Rectangle> {
    let mut runs: Vec<Rectangle> = Vec::with_capacity(quads.len() / 2);
    // By plane and direction, the run that was begun last.
    let mut latest = vec![NONE; 2 * planes as usize];
    for quad in quads {
        let run = RUN_SIDE[usize::from(quad.axis)];
        let row = 1 - run;
        let key = 2 * quad.plane as usize + usize::from(quad.faces_up);
        match runs.get_mut(latest[key] as usize) {
            Some(r) if r.hi[run] == quad.at[run] && r.lo[row] == quad.at[row] => r.hi[run] += 1,
            _ => {
                latest[key] = runs.len() as u32;
                runs.push(Rectangle::of(quad));
            }
        }
    }
    runs
}

/// Joins equal runs of neighbouring rows.
fn stack(runs: &[Rectangle], counts: [u32; 3], rectangles: &mut Vec<Rectangle>) {
    let Some(axis) = runs.first().map(|r| usize::from(r.axis)) else {
        return;
    };
    let run = RUN_SIDE[axis];
    let row = 1 - run;
    let starts = counts[(axis + 1 + run) % 3] as usize;
    let mut latest = vec![NONE; 2 * starts * (counts[axis] as usize + 1)];
    for r in runs {
        let place = r.plane as usize * starts + r.lo[run] as usize;
        let key = 2 * place + usize::from(r.faces_up);
        match rectangles.get_mut(latest[key] as usize) {
            Some(below) if below.hi[run] == r.hi[run] && below.hi[row] == r.lo[row] => {
                below.hi[row] = r.hi[row];
            }
            _ => {
                latest[key] = rectangles.len() as u32;
                rectangles.push(*r);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mask::ActiveMask;
    use proptest::prelude::*;
    use std::collections::HashSet;

    proptest! {
        #[test]
        fn rectangles_cover_each_face_once(
            counts in prop::array::uniform3(1usize..9),
            bits in prop::collection::vec(0u8..4, 512),
        ) {
            let mut mask = ActiveMask::inactive(counts);
            for (i, bit) in bits.iter().take(counts.iter().product()).enumerate() {
                let at = [i % counts[0], i / counts[0] % counts[1], i / counts[0] / counts[1]];
                mask.set(at, *bit > 0);
            }
            let mesh = BoundaryMesh::new(&mask);
            let mut left: HashSet<(u8, bool, u32, [u32; 2])> =
                mesh.quads().iter().map(|q| (q.axis, q.faces_up, q.plane, q.at)).collect();
            for r in merged(&mesh) {
                for v in r.lo[1]..r.hi[1] {
                    for u in r.lo[0]..r.hi[0] {
                        prop_assert!(left.remove(&(r.axis, r.faces_up, r.plane, [u, v])));
                    }
                }
            }
            prop_assert!(left.is_empty());
        }
    }

    #[test]
    fn a_box_has_six_rectangles() {
        let counts = [5, 4, 3];
        let mut mask = ActiveMask::inactive(counts);
        for i in 0..60 {
            mask.set([i % 5, i / 5 % 4, i / 20], true);
        }
        assert_eq!(merged(&BoundaryMesh::new(&mask)).len(), 6);
    }
}

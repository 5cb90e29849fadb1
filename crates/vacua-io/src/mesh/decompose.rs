//! Cells that are no tetrahedra, pyramids, wedges or hexahedra, cut into them.
//!
//! Faces of polyhedra are cut from their lowest point, polyhedra from their lowest point, so that
//! neighbours cut a common face the same way. (Dompierre and others 1999, *How to subdivide
//! pyramids, prisms and hexahedra into tetrahedra*.)

use glam::DVec3;
use robust::{Coord3D, orient3d};
use vacua_volume::CellType;

/// A prism over a pentagon: a hexahedron and a wedge; over a hexagon: two hexahedra.
pub(super) fn prism(sides: usize) -> [(CellType, &'static [usize]); 2] {
    match sides {
        5 => [
            (CellType::Hexahedron, &[0, 1, 2, 3, 5, 6, 7, 8]),
            (CellType::Wedge, &[0, 3, 4, 5, 8, 9]),
        ],
        _ => [
            (CellType::Hexahedron, &[0, 1, 2, 3, 6, 7, 8, 9]),
            (CellType::Hexahedron, &[0, 3, 4, 5, 6, 9, 10, 11]),
        ],
    }
}

/// Tetrahedra between the lowest point of a polyhedron and its faces that do not touch it: fills
/// convex polyhedra with plane faces exactly.
pub(super) fn polyhedron(faces: &[Vec<u64>], mut tetrahedron: impl FnMut([u64; 4])) {
    let Some(&apex) = faces.iter().flatten().min() else {
        return;
    };
    for face in faces.iter().filter(|face| !face.contains(&apex)) {
        let lowest = (0..face.len()).min_by_key(|&i| face[i]).unwrap_or(0);
        let at = |i: usize| face[(lowest + i) % face.len()];
        for i in 1..face.len().saturating_sub(1) {
            tetrahedron([at(0), at(i), at(i + 1), apex]);
        }
    }
}

/// Tetrahedra that fill the convex hull of points, by place in the list, each of positive volume:
/// point after point is joined to the faces of the hull so far that it sees. Points inside add
/// nothing; points that span no volume give nothing.
pub(super) fn convex_point_set(points: &[DVec3]) -> Vec<[usize; 4]> {
    let orientation = |a: usize, b: usize, c: usize, d: usize| {
        let at = |i: usize| {
            let DVec3 { x, y, z } = points[i];
            Coord3D { x, y, z }
        };
        // Positive if d is on the side to which the right-handed normal of a, b, c points.
        -orient3d(at(a), at(b), at(c), at(d))
    };
    let Some(mut first) = first_tetrahedron(points, orientation) else {
        return Vec::new();
    };
    let [a, b, c, d] = first;
    if orientation(a, b, c, d) < 0.0 {
        first = [a, c, b, d];
    }
    let [a, b, c, d] = first;
    // Faces with their normals outward.
    let mut hull = vec![[a, c, b], [a, b, d], [b, c, d], [c, a, d]];
    let mut filled = vec![first];
    for point in (0..points.len()).filter(|p| !first.contains(p)) {
        let (seen, kept): (Vec<_>, Vec<_>) = hull
            .into_iter()
            .partition(|&[a, b, c]| orientation(a, b, c, point) > 0.0);
        hull = kept;
        for &[a, b, c] in &seen {
            filled.push([a, b, c, point]);
            for edge in [[a, b], [b, c], [c, a]] {
                let [from, to] = edge;
                let has_reverse =
                    |f: &[usize; 3]| (0..3).any(|i| f[i] == to && f[(i + 1) % 3] == from);
                if !seen.iter().any(has_reverse) {
                    hull.push([from, to, point]);
                }
            }
        }
    }
    filled
}

/// Four points that span a volume: the first of all that do, each as early as possible.
fn first_tetrahedron(
    points: &[DVec3],
    orientation: impl Fn(usize, usize, usize, usize) -> f64,
) -> Option<[usize; 4]> {
    let n = points.len();
    let b = (1..n).find(|&i| points[i] != points[0])?;
    let along = points[b] - points[0];
    // Off the line as far as can be told without exact arithmetic; what is decided exactly is the
    // volume.
    let off = |i: usize| along.cross(points[i] - points[0]).length_squared();
    let c = (1..n).max_by(|&i, &j| off(i).total_cmp(&off(j)).then(j.cmp(&i)))?;
    let d = (1..n).find(|&i| orientation(0, b, c, i) != 0.0)?;
    Some([0, b, c, d])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn volume(points: &[DVec3], t: [usize; 4]) -> f64 {
        let [a, b, c, d] = t.map(|i| points[i]);
        (b - a).cross(c - a).dot(d - a) / 6.0
    }

    fn cube() -> Vec<DVec3> {
        (0..8)
            .map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)))
            .collect()
    }

    #[test]
    fn a_cube_and_its_middle() {
        let mut points = cube();
        points.insert(0, DVec3::splat(0.5));
        let filled = convex_point_set(&points);
        assert!(filled.iter().all(|&t| volume(&points, t) > 0.0));
        let sum: f64 = filled.iter().map(|&t| volume(&points, t)).sum();
        assert!((sum - 1.0).abs() < 1e-12);
        let flat: Vec<DVec3> = cube().into_iter().filter(|p| p.z == 0.0).collect();
        assert_eq!(convex_point_set(&flat), Vec::<[usize; 4]>::new());
        assert!(convex_point_set(&[DVec3::ONE; 9]).is_empty());
        assert!(convex_point_set(&[]).is_empty());
    }

    #[test]
    fn a_cube_by_its_faces() {
        let points = cube();
        let faces: Vec<Vec<u64>> = [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ]
        .map(|f| f.to_vec())
        .to_vec();
        let mut sum = 0.0;
        polyhedron(&faces, |t| {
            sum += volume(&points, t.map(|i| i as usize)).abs();
        });
        assert!((sum - 1.0).abs() < 1e-12);
        polyhedron(&[], |_| unreachable!());
        polyhedron(&[Vec::new(), vec![1], vec![1, 2]], |_| unreachable!());
    }

    #[test]
    fn prisms_are_filled() {
        for sides in [5usize, 6] {
            let points: Vec<DVec3> = (0..2 * sides)
                .map(|i| {
                    let angle = (i % sides) as f64 / sides as f64 * std::f64::consts::TAU;
                    DVec3::new(angle.cos(), angle.sin(), (i / sides) as f64)
                })
                .collect();
            // Each part is a prism over a polygon, so that its volume is that of the polygon.
            let area = |polygon: &[usize]| -> f64 {
                (0..polygon.len())
                    .map(|i| {
                        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
                        0.5 * points[a].truncate().perp_dot(points[b].truncate())
                    })
                    .sum()
            };
            let whole = area(&(0..sides).collect::<Vec<_>>());
            let parts = prism(sides);
            let sum: f64 = parts.iter().map(|(_, c)| area(&c[..c.len() / 2])).sum();
            assert!((sum - whole).abs() < 1e-12);
            for (cell_type, corners) in parts {
                assert_eq!(corners.len(), cell_type.num_points());
                let half = corners.len() / 2;
                assert!((0..half).all(|i| corners[i] + sides == corners[half + i]));
            }
        }
    }

    proptest! {
        #[test]
        fn any_points_fill_their_hull(
            points in prop::collection::vec(prop::array::uniform3(-2i8..3), 0..20),
        ) {
            let points: Vec<DVec3> =
                points.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
            let filled = convex_point_set(&points);
            prop_assert!(filled.iter().all(|&t| volume(&points, t) > 0.0));
            // Every point is in the closed hull: joined to the boundary it adds no volume.
            let sum: f64 = filled.iter().map(|&t| volume(&points, t)).sum();
            let mut reversed = points.clone();
            reversed.reverse();
            let again: f64 =
                convex_point_set(&reversed).iter().map(|&t| volume(&reversed, t)).sum();
            prop_assert!((sum - again).abs() < 1e-9, "{} {}", sum, again);
        }
    }
}

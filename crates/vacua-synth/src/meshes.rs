//! The benchmark meshes as raw arrays: a jittered cube of tetrahedra or hexahedra with an analytic
//! scalar, bit for bit as NumPy made `tet100` and `hex150`.
//!
//! Positions are cell edges apart before the jitter of ± [`JITTER`]; vertices on the boundary stay
//! in their plane, so that the volume is exactly `n³`.

use rayon::prelude::*;

use crate::kind::SynthError;
use crate::numpy::{Pcg64, cos, exp_nonpositive, sin};

/// How far a vertex moves along each axis at most, in cell edges.
pub const JITTER: f64 = 0.15;

/// Vertices, cells of `N` vertices each, and one scalar a vertex.
#[derive(Clone, Debug, PartialEq)]
pub struct RawMesh<const N: usize> {
    /// Position of each vertex, in cell edges.
    pub vertices: Vec<[f32; 3]>,
    /// Vertex indices of each cell, in VTK order.
    pub cells: Vec<[i32; N]>,
    /// A smooth value at each vertex, about 0 to 1.
    pub scalars: Vec<f32>,
}

/// The six tetrahedra of a hexahedron, all around the diagonal from corner 0 to corner 6.
pub(crate) const TETRAHEDRA: [[usize; 4]; 6] = [
    [0, 1, 2, 6],
    [0, 2, 3, 6],
    [0, 3, 7, 6],
    [0, 7, 4, 6],
    [0, 4, 5, 6],
    [0, 5, 1, 6],
];

/// A cube of `n³` jittered hexahedra (their faces are not planar); `n = 150`, `seed = 2` is the
/// benchmark scene `hex150`.
///
/// # Errors
/// [`SynthError`] if `n` is 0 or the vertex indices exceed 32 bits.
pub fn hexahedra(n: usize, seed: u32) -> Result<RawMesh<8>, SynthError> {
    let vertices = jittered(n, seed)?;
    Ok(RawMesh {
        scalars: smooth(&vertices, n),
        cells: hexahedron_corners(n),
        vertices,
    })
}

/// A cube of `n³` cells of six tetrahedra each, all of positive volume; `n = 100`, `seed = 1` is
/// the benchmark scene `tet100`.
///
/// # Errors
/// [`SynthError`] if `n` is 0 or the vertex indices exceed 32 bits.
pub fn tetrahedra(n: usize, seed: u32) -> Result<RawMesh<4>, SynthError> {
    let vertices = jittered(n, seed)?;
    let cells = hexahedron_corners(n)
        .into_par_iter()
        .flat_map_iter(|corners| TETRAHEDRA.map(|t| t.map(|corner| corners[corner])))
        .collect();
    Ok(RawMesh {
        scalars: smooth(&vertices, n),
        cells,
        vertices,
    })
}

/// Corners of the cells of a lattice of `n³` cells, x fastest.
fn hexahedron_corners(n: usize) -> Vec<[i32; 8]> {
    let (row, layer) = (n as i32 + 1, (n as i32 + 1) * (n as i32 + 1));
    let offsets = [0, 1, 1 + row, row].map(|o| [o, o + layer]);
    (0..n * n * n)
        .into_par_iter()
        .map(|cell| {
            let (x, y, z) = (cell % n, cell / n % n, cell / (n * n));
            let base = x as i32 + row * y as i32 + layer * z as i32;
            std::array::from_fn(|i| base + offsets[i % 4][i / 4])
        })
        .collect()
}

/// The vertices of a lattice of `n³` cells, moved by up to [`JITTER`].
fn jittered(n: usize, seed: u32) -> Result<Vec<[f32; 3]>, SynthError> {
    let side = n.saturating_add(1);
    let count = side
        .checked_pow(3)
        .filter(|&count| n > 0 && count <= i32::MAX as usize);
    let Some(count) = count else {
        let points = [side; 3];
        return Err(if n == 0 {
            SynthError::TooSmall { points }
        } else {
            SynthError::TooLarge { points }
        });
    };
    let mut rng = Pcg64::new(seed);
    let vertices = (0..count).map(|i| {
        [i % side, i / side % side, i / (side * side)].map(|coordinate| {
            let move_by = rng.uniform(-JITTER, JITTER) as f32;
            if coordinate == 0 || coordinate == n {
                coordinate as f32
            } else {
                coordinate as f32 + move_by
            }
        })
    });
    Ok(vertices.collect())
}

/// A bump and a wave, in `f32` as NumPy evaluates them.
pub(crate) fn smooth(vertices: &[[f32; 3]], n: usize) -> Vec<f32> {
    let n = n as f32;
    vertices
        .par_iter()
        .map(|vertex| {
            let q = vertex.map(|c| c / n);
            let sq = q.map(|c| (c - 0.45) * (c - 0.45));
            let bump = exp_nonpositive(-(sq[0] + sq[1] + sq[2]) / 0.05);
            let wave = 0.5 + 0.5 * sin(9.0 * q[0]) * cos(7.0 * q[1]) * sin(8.0 * q[2]);
            0.6 * bump + 0.4 * wave
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(mesh: &RawMesh<4>, cell: [i32; 4]) -> f64 {
        let [a, b, c, d] =
            cell.map(|v| glam::DVec3::from_array(mesh.vertices[v as usize].map(f64::from)));
        (b - a).cross(c - a).dot(d - a) / 6.0
    }

    #[test]
    fn tetrahedra_fill_the_cube() {
        let mesh = tetrahedra(9, 7).expect("small");
        assert_eq!(mesh.cells.len(), 6 * 9 * 9 * 9);
        let volumes: Vec<f64> = mesh.cells.iter().map(|&t| volume(&mesh, t)).collect();
        assert!(volumes.iter().all(|&v| v > 0.0));
        assert!((volumes.iter().sum::<f64>() - 729.0).abs() < 1e-3);
    }

    #[test]
    fn sizes_are_checked() {
        assert!(matches!(hexahedra(0, 1), Err(SynthError::TooSmall { .. })));
        assert!(matches!(
            tetrahedra(1290, 1),
            Err(SynthError::TooLarge { .. })
        ));
        assert!(matches!(
            hexahedra(usize::MAX, 1),
            Err(SynthError::TooLarge { .. })
        ));
    }
}

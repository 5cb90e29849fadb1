//! Meshes after those of paper B's Table 3: jets, a lander with its boundary layers, an ocean.

use std::collections::HashMap;

use glam::DVec3;
use vacua_volume::CellType;

use crate::kind::SynthError;
use crate::mesh_cells::{Cells, Random, check_points};

/// The three tetrahedra of a wedge, cut so that neighbours agree: from its lowest points.
fn tetrahedra_of_wedge(w: [u32; 6]) -> [[u32; 4]; 3] {
    // Turned so that the lowest point comes first, which keeps the orientation.
    let lowest = (0..6).min_by_key(|&i| w[i]).unwrap_or(0);
    let turns: [[usize; 6]; 6] = [
        [0, 1, 2, 3, 4, 5],
        [1, 2, 0, 4, 5, 3],
        [2, 0, 1, 5, 3, 4],
        [3, 5, 4, 0, 2, 1],
        [4, 3, 5, 1, 0, 2],
        [5, 4, 3, 2, 1, 0],
    ];
    let v = turns[lowest].map(|i| w[i]);
    if v[1].min(v[5]) < v[2].min(v[4]) {
        [
            [v[0], v[1], v[2], v[5]],
            [v[0], v[1], v[5], v[4]],
            [v[0], v[4], v[5], v[3]],
        ]
    } else {
        [
            [v[0], v[1], v[2], v[4]],
            [v[0], v[4], v[2], v[5]],
            [v[0], v[4], v[5], v[3]],
        ]
    }
}

/// `6n³` tetrahedra in a cube of side `n`, planes closer to each other around two jets.
pub(crate) fn jets(n: usize, seed: u64) -> Result<Cells, SynthError> {
    let side = n + 1;
    let count = check_points(n, side.checked_pow(3))?;
    let mut random = Random(seed);
    // Planes crowd at a quarter and at three quarters, where the jets are.
    let crowded = |i: usize| {
        let q = i as f64 / n as f64;
        (q + (4.0 * std::f64::consts::PI * q).sin() / (8.0 * std::f64::consts::PI)) * n as f64
    };
    let mut cells = Cells::default();
    for point in 0..count {
        let at = [point % side, point / side % side, point / (side * side)];
        let gap = |i: usize| crowded(i + 1).min(n as f64) - crowded(i.saturating_sub(1));
        cells.points.push(std::array::from_fn(|axis| {
            let i = at[axis];
            let inner = i > 0 && i < n;
            let here = if axis == 2 { i as f64 } else { crowded(i) };
            let room = if axis == 2 || !inner {
                0.5
            } else {
                0.25 * gap(i)
            };
            let move_by = if inner {
                room * 0.6 * (random.unit() - 0.5)
            } else {
                0.0
            };
            (here + move_by) as f32
        }));
    }
    let number = |x: usize, y: usize, z: usize| (x + side * (y + side * z)) as u32;
    for z in 0..n {
        for y in 0..n {
            for x in 0..n {
                let c = [
                    number(x, y, z),
                    number(x + 1, y, z),
                    number(x + 1, y + 1, z),
                    number(x, y + 1, z),
                    number(x, y, z + 1),
                    number(x + 1, y, z + 1),
                    number(x + 1, y + 1, z + 1),
                    number(x, y + 1, z + 1),
                ];
                for t in crate::meshes::TETRAHEDRA {
                    cells.push(CellType::Tetrahedron, t.map(|i| c[i]));
                }
            }
        }
    }
    Ok(cells)
}

/// A ball of radius a quarter of `n` in the middle of `[0, n]³`: a quarter of the layers around it are
/// wedges, thin near the body; the others are tetrahedra. About `14 n³` cells.
pub(crate) fn lander(n: usize) -> Result<Cells, SynthError> {
    let m = n.max(2);
    let (layers, wedge_layers) = (m, (m / 4).max(1));
    let num_surface = m
        .checked_mul(m)
        .and_then(|n| n.checked_mul(4))
        .and_then(|n| n.checked_add(2));
    check_points(n, num_surface.and_then(|s| s.checked_mul(layers + 1)))?;
    let (surface, triangles) = octahedron(m);
    let half = 0.5 * n as f64;
    let radius = |layer: usize| {
        let t = layer as f64 / layers as f64;
        half * (0.5 + 0.5 * t.powf(1.7))
    };
    let mut cells = Cells::default();
    for layer in 0..=layers {
        for direction in &surface {
            let p = half + radius(layer) * *direction;
            cells.points.push(p.as_vec3().to_array());
        }
    }
    let stride = surface.len() as u32;
    for layer in 0..layers {
        let base = layer as u32 * stride;
        for t in &triangles {
            let [a, b, c] = t.map(|p| base + p);
            let wedge = [a, b, c, a + stride, b + stride, c + stride];
            if layer < wedge_layers {
                cells.push(CellType::Wedge, wedge);
            } else {
                for tetrahedron in tetrahedra_of_wedge(wedge) {
                    cells.push(CellType::Tetrahedron, tetrahedron);
                }
            }
        }
    }
    Ok(cells)
}

/// A sphere of radius 1 from an octahedron whose edges are cut into `m`: points and triangles, seen
/// counter-clockwise from outside.
fn octahedron(m: usize) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    let mut known: HashMap<[i64; 3], u32> = HashMap::new();
    for octant in 0..8 {
        let sign = [0, 1, 2].map(|axis| if octant >> axis & 1 == 1 { -1i64 } else { 1 });
        let flipped = sign.iter().product::<i64>() < 0;
        let mut at = |i: usize, j: usize| {
            let k = m - i - j;
            let place = [i as i64 * sign[0], j as i64 * sign[1], k as i64 * sign[2]];
            *known.entry(place).or_insert_with(|| {
                points.push(DVec3::from_array(place.map(|c| c as f64)).normalize());
                points.len() as u32 - 1
            })
        };
        let mut add = |[a, b, c]: [u32; 3]| {
            triangles.push(if flipped { [a, c, b] } else { [a, b, c] });
        };
        for i in 0..m {
            for j in 0..m - i {
                add([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 1 < m {
                    add([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    (points, triangles)
}

/// Columns of wedges over a floor of hills, `2n²` columns of up to `n/4` layers, thinner near the
/// surface; land where the floor is higher than the sea.
pub(crate) fn ocean(n: usize, seed: u64) -> Result<Cells, SynthError> {
    let side = n + 1;
    let layers = (n / 4).max(1);
    let per_layer = side.checked_mul(side);
    check_points(n, per_layer.and_then(|p| p.checked_mul(layers + 1)))?;
    let mut random = Random(seed);
    let depth = |layer: usize| -0.1 * n as f64 * (layer as f64 / layers as f64).powf(1.6);
    let surface: Vec<[f64; 2]> = (0..side * side)
        .map(|p| {
            [p % side, p / side].map(|i| {
                let inner = i > 0 && i < n;
                let move_by = if inner {
                    0.5 * (random.unit() - 0.5)
                } else {
                    0.0
                };
                i as f64 + move_by
            })
        })
        .collect();
    // Layers of water at a place.
    let water = |[x, y]: [f64; 2]| {
        let (u, v) = (x / n as f64, y / n as f64);
        let floor =
            0.75 + 0.5 * (9.0 * u).sin() * (7.0 * v + 1.0).cos() - 0.3 * (17.0 * u * v).cos();
        (floor.clamp(0.0, 1.0) * layers as f64).round() as usize
    };
    let mut cells = Cells::default();
    let mut number: HashMap<(u32, u32), u32> = HashMap::new();
    let (mut points, surface_of) = (Vec::new(), &surface);
    let mut at = |p: usize, layer: usize| {
        *number.entry((p as u32, layer as u32)).or_insert_with(|| {
            let [x, y] = surface_of[p];
            points.push([x as f32, y as f32, depth(layer) as f32]);
            points.len() as u32 - 1
        })
    };
    for y in 0..n {
        for x in 0..n {
            let corners = [
                x + side * y,
                x + 1 + side * y,
                x + 1 + side * (y + 1),
                x + side * (y + 1),
            ];
            for t in [[0, 1, 2], [0, 2, 3]] {
                let t = t.map(|i| corners[i]);
                let middle =
                    [0, 1].map(|axis| t.iter().map(|&p| surface[p][axis]).sum::<f64>() / 3.0);
                for layer in 0..water(middle) {
                    let top = t.map(|p| at(p, layer));
                    let bottom = t.map(|p| at(p, layer + 1));
                    cells.push(CellType::Wedge, bottom.into_iter().chain(top));
                }
            }
        }
    }
    cells.points = points;
    Ok(cells)
}

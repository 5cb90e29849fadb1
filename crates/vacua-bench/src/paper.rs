//! What paper A reports (Wald, Zellmann and Morrical 2021, §5, Tables 1 to 4; an RTX 8000 and
//! pictures of 3840×2160), as plain data.

use serde::{Deserialize, Serialize};

use crate::skip::Model;

/// Paper A's own default macrocell side, at which its Table 4 is measured.
pub const DEFAULT_SIDE: usize = 16;

/// Seconds to rebuild, in the order of the columns of Tables 1 and 2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PaperTimes {
    /// `T_tf`.
    pub classify_secs: f64,
    /// `T_tris`: boundary triangles, or clustering.
    pub shape_secs: f64,
    /// `T_BVH`.
    pub hierarchy_secs: f64,
    /// `T_total`, which is more than the sum.
    pub total_secs: f64,
}

/// One row of Table 1 and its neighbour in Table 2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PaperBuild {
    /// Macrocells.
    pub macrocells: u64,
    /// Active macrocells.
    pub active: u64,
    /// Boundary triangles.
    pub triangles: u64,
    /// Table 1.
    pub mesh: PaperTimes,
    /// Table 2.
    pub boxes: PaperTimes,
}

type Row = (Model, usize, [f64; 3], [f64; 4], [f64; 4]);

/// Model, K, thousands (macrocells, active, triangles), milliseconds of Table 1 and of Table 2.
const BUILDS: [Row; 12] = {
    use Model::{Dns, Flower, Heptane, Llnl};
    [
        (
            Heptane,
            8,
            [54.9, 12.3, 18.1],
            [0.042, 0.054, 1.6, 2.1],
            [0.039, 3.3, 2.1, 5.9],
        ),
        (
            Flower,
            8,
            [2100.0, 180.0, 318.0],
            [0.134, 0.115, 4.8, 5.4],
            [0.142, 53.2, 5.0, 58.7],
        ),
        (
            Dns,
            8,
            [3700.0, 660.0, 1500.0],
            [0.206, 0.225, 12.3, 13.1],
            [0.256, 136.7, 11.6, 149.1],
        ),
        (
            Llnl,
            8,
            [15700.0, 2900.0, 4200.0],
            [0.998, 0.904, 28.2, 30.4],
            [0.991, 641.5, 44.2, 687.2],
        ),
        (
            Heptane,
            16,
            [6.9, 2.0, 3.4],
            [0.047, 0.066, 0.918, 1.4],
            [0.042, 0.528, 1.3, 2.4],
        ),
        (
            Flower,
            16,
            [275.0, 33.0, 78.0],
            [0.059, 0.057, 3.0, 3.6],
            [0.055, 9.9, 2.7, 13.1],
        ),
        (
            Dns,
            16,
            [461.0, 122.0, 366.0],
            [0.067, 0.069, 5.3, 5.8],
            [0.064, 25.6, 4.4, 30.4],
        ),
        (
            Llnl,
            16,
            [1970.0, 475.0, 422.0],
            [0.153, 0.119, 5.4, 6.0],
            [0.154, 95.1, 8.9, 104.5],
        ),
        (
            Heptane,
            32,
            [1.0, 0.358, 0.856],
            [0.037, 0.044, 0.589, 1.0],
            [0.037, 0.101, 1.0, 1.6],
        ),
        (
            Flower,
            32,
            [33.0, 6.8, 19.0],
            [0.037, 0.045, 1.8, 2.2],
            [0.038, 1.8, 1.4, 3.6],
        ),
        (
            Dns,
            32,
            [58.0, 26.0, 98.0],
            [0.040, 0.048, 2.8, 3.2],
            [0.046, 5.8, 2.5, 8.8],
        ),
        (
            Llnl,
            32,
            [246.0, 69.0, 54.0],
            [0.052, 0.059, 2.3, 2.8],
            [0.052, 14.1, 3.1, 17.7],
        ),
    ]
};

/// Model, rays a pixel, frames per second of the base, of boxes and of the mesh at K = 8, 16, 32.
const FRAMES: [(Model, u32, f64, [f64; 3], [f64; 3]); 8] = {
    use Model::{Dns, Flower, Heptane, Llnl};
    [
        (Heptane, 1, 34.0, [79.0, 81.0, 67.0], [100.0, 93.0, 71.0]),
        (Flower, 1, 14.0, [95.0, 88.0, 54.0], [154.0, 111.0, 64.0]),
        (Dns, 1, 13.0, [24.0, 25.0, 19.0], [40.0, 34.0, 23.0]),
        (Llnl, 1, 8.0, [23.0, 27.0, 19.0], [34.0, 40.0, 43.0]),
        (Heptane, 4, 9.0, [17.0, 18.0, 15.0], [29.0, 22.0, 18.0]),
        (Flower, 4, 3.0, [26.0, 18.0, 11.0], [36.0, 23.0, 13.0]),
        (Dns, 4, 3.0, [5.0, 4.0, 3.0], [9.0, 7.0, 5.0]),
        (Llnl, 4, 2.0, [4.0, 4.0, 5.0], [7.0, 8.0, 9.0]),
    ]
};

/// Table 4: model, frames per second of the base, of boxes (not rebuilt, rebuilt) and of the mesh.
const REBUILDS: [(Model, f64, [f64; 2], [f64; 2]); 4] = [
    (Model::Heptane, 34.0, [81.0, 68.0], [93.0, 84.0]),
    (Model::Flower, 14.0, [88.0, 41.0], [111.0, 83.0]),
    (Model::Dns, 13.0, [25.0, 14.0], [34.0, 28.0]),
    (Model::Llnl, 8.0, [27.0, 7.0], [41.0, 32.0]),
];

/// The rows of Tables 1 and 2 for a model and a macrocell side, if the paper has them.
pub fn build(model: Model, side: usize) -> Option<PaperBuild> {
    let times = |ms: [f64; 4]| PaperTimes {
        classify_secs: ms[0] * 1e-3,
        shape_secs: ms[1] * 1e-3,
        hierarchy_secs: ms[2] * 1e-3,
        total_secs: ms[3] * 1e-3,
    };
    let &(_, _, thousands, mesh, boxes) = BUILDS.iter().find(|r| r.0 == model && r.1 == side)?;
    let [macrocells, active, triangles] = thousands.map(|n| (n * 1e3).round() as u64);
    Some(PaperBuild {
        macrocells,
        active,
        triangles,
        mesh: times(mesh),
        boxes: times(boxes),
    })
}

/// Frames per second in Table 3 by the name of the method (`none`, `boxes`, `mesh`).
pub fn frames(model: Model, rays: u32, method: &str, side: Option<usize>) -> Option<f64> {
    let row = FRAMES.iter().find(|r| r.0 == model && r.1 == rays)?;
    let column = |values: &[f64; 3]| {
        let index = [8, 16, 32].iter().position(|&k| Some(k) == side)?;
        Some(values[index])
    };
    match method {
        "none" => Some(row.2),
        "boxes" => column(&row.3),
        "mesh" => column(&row.4),
        _ => None,
    }
}

/// Frames per second in Table 4 by the name of the method.
pub fn rebuilds(model: Model, method: &str, rebuilt: bool) -> Option<f64> {
    let row = REBUILDS.iter().find(|r| r.0 == model)?;
    match method {
        "none" if !rebuilt => Some(row.1),
        "boxes" => Some(row.2[usize::from(rebuilt)]),
        "mesh" => Some(row.3[usize::from(rebuilt)]),
        _ => None,
    }
}

//! What paper B reports (Wald, Morrical and Zellmann 2022, Tables 1 to 6), and what the peers that
//! were measured on a machine like this give, as plain data. Its GB and MB are powers of two.

use vacua_synth::MeshKind;

/// A GB of the paper.
const GB: f64 = (1u64 << 30) as f64;
/// An MB of the paper.
pub const MB: f64 = (1u64 << 20) as f64;

/// Bytes of a model's parts in Table 3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperModel {
    /// Its name there.
    pub name: &'static str,
    /// Vertices of the input.
    pub vertices: f64,
    /// Elements of the input.
    pub cells: f64,
    /// Vertices, replicated ones included.
    pub vertex_bytes: f64,
    /// Indices.
    pub index_bytes: f64,
    /// Multi-leaves of variant 1, and nodes of variant 2.
    pub node_bytes: [f64; 2],
    /// OptiX' hierarchy over multi-leaves.
    pub optix_bytes: f64,
    /// All of variant 1.
    pub variant_1_bytes: f64,
    /// All of variant 2.
    pub variant_2_bytes: f64,
    /// OSPRay 1.8.5, Table 5.
    pub ospray_1_bytes: Option<f64>,
    /// OSPRay 2.0, Table 5.
    pub ospray_2_bytes: Option<f64>,
}

const JETS: PaperModel = PaperModel {
    name: "Jets",
    vertices: 2e6,
    cells: 12e6,
    vertex_bytes: 34.0 * MB,
    index_bytes: 58.0 * MB,
    node_bytes: [11.0 * MB, 14.0 * MB],
    optix_bytes: 13.0 * MB,
    variant_1_bytes: 116.0 * MB,
    variant_2_bytes: 106.0 * MB,
    ospray_1_bytes: None,
    ospray_2_bytes: None,
};

const LANDER_SMALL: PaperModel = PaperModel {
    name: "Mars Lander Small",
    vertices: 143e6,
    cells: 789e6,
    vertex_bytes: 2.39 * GB,
    index_bytes: 4.5 * GB,
    node_bytes: [1.16 * GB, 1.49 * GB],
    optix_bytes: 1.27 * GB,
    variant_1_bytes: 9.3 * GB,
    variant_2_bytes: 8.38 * GB,
    ospray_1_bytes: Some(90.2 * GB),
    ospray_2_bytes: Some(117.0 * GB),
};

const OCEAN: PaperModel = PaperModel {
    name: "DKRZ Full Ocean",
    vertices: 485e6,
    cells: 749e6,
    vertex_bytes: 6.62 * GB,
    index_bytes: 11.2 * GB,
    node_bytes: [2.41 * GB, 3.20 * GB],
    optix_bytes: 2.67 * GB,
    variant_1_bytes: 22.9 * GB,
    variant_2_bytes: 21.0 * GB,
    ospray_1_bytes: None,
    ospray_2_bytes: Some(123.0 * GB),
};

const EXA_JET: PaperModel = PaperModel {
    name: "NASA Exa-Jet",
    vertices: 656e6,
    cells: 652e6,
    vertex_bytes: 10.8 * GB,
    index_bytes: 10.4 * GB,
    node_bytes: [2.34 * GB, 3.33 * GB],
    optix_bytes: 2.59 * GB,
    variant_1_bytes: 26.9 * GB,
    variant_2_bytes: 24.5 * GB,
    ospray_1_bytes: None,
    ospray_2_bytes: Some(120.0 * GB),
};

/// The model of the paper that a mesh is most like.
pub const fn model(kind: MeshKind) -> PaperModel {
    match kind {
        MeshKind::Tet100 | MeshKind::Jets | MeshKind::Delaunay => JETS,
        MeshKind::Lander => LANDER_SMALL,
        MeshKind::Ocean => OCEAN,
        MeshKind::Hex150 | MeshKind::Octree => EXA_JET,
    }
}

/// Bytes a cell to stay within, values and ranges counted, for a variant by name; where the issue of
/// unstructured meshes sets a figure.
pub fn target(kind: MeshKind, variant: &str) -> Option<f64> {
    let [one, two, small] = match kind {
        MeshKind::Tet100 => [10.9, 9.9, 6.0],
        MeshKind::Hex150 => [45.0, 42.0, 24.0],
        MeshKind::Ocean => [34.5, 32.0, f64::NAN],
        MeshKind::Jets | MeshKind::Delaunay | MeshKind::Lander | MeshKind::Octree => return None,
    };
    let target = match variant {
        "1" => one,
        "2" => two,
        "small" => small,
        _ => f64::NAN,
    };
    target.is_finite().then_some(target)
}

impl PaperModel {
    /// Bytes of a variant by name, if the paper has it.
    pub fn variant_bytes(&self, variant: &str) -> Option<f64> {
        match variant {
            "1" => Some(self.variant_1_bytes),
            "2" => Some(self.variant_2_bytes),
            _ => None,
        }
    }
}

/// Elements of the big Mars Lander, of which Table 1 is.
pub const TABLE_1_CELLS: f64 = 2.95e9;

/// Table 1: bytes of OSPRay 1.8.5 on the big Mars Lander, by part as [`vacua_pack::reference::MinMaxBvh`]
/// names them.
pub const TABLE_1: [(&str, f64); 4] = [
    ("vertices", 8.6 * GB),
    ("indices", 87.8 * GB),
    ("nodes", 214.0 * GB),
    ("item list", 22.0 * GB),
];

/// Table 2, a row a number of index bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperBits {
    /// Bits of an index.
    pub bits: u32,
    /// Sub-meshes.
    pub groups: f64,
    /// Vertices a sub-mesh.
    pub vertices_per_group: f64,
    /// Vertices, replicated ones included, over those without.
    pub replication: f64,
    /// Vertices and indices, in bytes.
    pub bytes: f64,
}

/// Table 2. Its `620 M +12.8 %` is taken as 620 M over 570 M.
pub const TABLE_2: [PaperBits; 5] = [
    PaperBits {
        bits: 32,
        groups: 1.0,
        vertices_per_group: 570e6,
        replication: 1.0,
        bytes: 50.0 * GB,
    },
    PaperBits {
        bits: 16,
        groups: 15.1e3,
        vertices_per_group: 32e3,
        replication: 620.0 / 570.0,
        bytes: 28.0 * GB,
    },
    PaperBits {
        bits: 14,
        groups: 63.7e3,
        vertices_per_group: 10.8e3,
        replication: 671.0 / 570.0,
        bytes: 26.0 * GB,
    },
    PaperBits {
        bits: 12,
        groups: 286e3,
        vertices_per_group: 2.7e3,
        replication: 765.0 / 570.0,
        bytes: 25.0 * GB,
    },
    PaperBits {
        bits: 8,
        groups: 4e6,
        vertices_per_group: 425.0,
        replication: 1700.0 / 570.0,
        bytes: 30.0 * GB,
    },
];

/// Table 2's primitives, for bytes a cell.
pub const TABLE_2_CELLS: f64 = 2.7e9;

/// Table 4: 64ths of the big Mars Lander, and bytes of the packed form, user geometry and shared
/// faces, which ran out of memory.
pub const TABLE_4: [(usize, f64, f64, Option<f64>); 2] = [
    (4, 2.4 * GB, 14.5 * GB, Some(34.0 * GB)),
    (12, 6.6 * GB, 39.3 * GB, None),
];

/// Shares that Table 4's parts are of.
pub const TABLE_4_SHARES: usize = 64;

/// Tetrahedra of the mesh of Table 6.
pub const TABLE_6_CELLS: f64 = 12e6;

/// Shares that Table 6's parts are of.
pub const TABLE_6_SHARES: usize = 8;

/// Table 6: seconds a frame and MB, part by part.
pub const TABLE_6: [(&str, [f64; 8], [f64; 8]); 4] = [
    (
        "packed",
        [0.34, 0.73, 1.03, 1.30, 1.70, 2.02, 2.15, 2.18],
        [16.0, 31.0, 50.0, 62.0, 81.0, 99.0, 111.0, 123.0],
    ),
    (
        "user geometry",
        [0.57, 1.42, 2.24, 2.90, 3.79, 4.43, 4.72, 4.96],
        [102.0, 206.0, 311.0, 416.0, 520.0, 625.0, 730.0, 831.0],
    ),
    (
        "shared faces",
        [0.05, 0.12, 0.17, 0.21, 0.28, 0.32, 0.35, 0.39],
        [255.0, 512.0, 768.0, 1020.0, 1280.0, 1540.0, 1790.0, 2040.0],
    ),
    (
        "tet marching",
        [0.03, 0.07, 0.10, 0.15, 0.20, 0.23, 0.24, 0.24],
        [65.0, 120.0, 175.0, 230.0, 285.0, 340.0, 395.0, 440.0],
    ),
];

/// What Open VKL 2.0 gives on two cores with AVX-512: samples a second in ray order, at random, and in
/// Morton order (middles of the ranges measured), and bytes a cell with those of its caller.
pub const fn open_vkl(kind: MeshKind) -> Option<([f64; 3], f64)> {
    match kind {
        MeshKind::Tet100 => Some(([4.35e6, 0.42e6, 4.9e6], 230.0)),
        MeshKind::Hex150 => Some(([6.5e6, 0.50e6, 5.9e6], 268.0)),
        _ => None,
    }
}

/// Samples a second to reach, in ray order and at random, on two cores.
pub const fn sampling_target(kind: MeshKind) -> Option<[f64; 2]> {
    match kind {
        MeshKind::Tet100 => Some([25e6, 4e6]),
        MeshKind::Hex150 => Some([15e6, 3e6]),
        _ => None,
    }
}

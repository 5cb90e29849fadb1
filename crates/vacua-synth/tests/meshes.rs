//! Procedural meshes: volumes, cell types, and that what is asked for happens.

use glam::DVec3;
use vacua_synth::{MeshKind, MeshSpec, MeshValues, generate_mesh, linear_value};
use vacua_volume::{CellType, Dataset, UnstructuredMesh};

fn small(kind: MeshKind) -> MeshSpec {
    let size = match kind {
        MeshKind::Octree => 16,
        _ => 8,
    };
    MeshSpec {
        size,
        ..MeshSpec::new(kind)
    }
}

fn mesh(dataset: &Dataset) -> &UnstructuredMesh {
    dataset.mesh().expect("a mesh")
}

/// Volume by the divergence theorem over faces cut in two; positive if the cell is not inverted.
fn volume(mesh: &UnstructuredMesh, cell: usize) -> f64 {
    let cell = mesh.cell(cell);
    let at: Vec<DVec3> = cell
        .points()
        .iter()
        .map(|&p| mesh.position(p as usize))
        .collect();
    let tetrahedra: &[[usize; 4]] = match cell.cell_type {
        CellType::Tetrahedron => &[[0, 1, 2, 3]],
        CellType::Pyramid => &[[0, 1, 2, 4], [0, 2, 3, 4]],
        CellType::Wedge => &[[0, 1, 2, 3], [1, 4, 2, 3], [2, 4, 5, 3]],
        CellType::Hexahedron => &[
            [0, 1, 2, 6],
            [0, 2, 3, 6],
            [0, 3, 7, 6],
            [0, 7, 4, 6],
            [0, 4, 5, 6],
            [0, 5, 1, 6],
        ],
    };
    let one = |t: &[usize; 4]| {
        let [a, b, c, d] = t.map(|i| at[i]);
        (b - a).cross(c - a).dot(d - a) / 6.0
    };
    tetrahedra.iter().map(one).sum()
}

#[test]
fn every_kind_fills_its_room() {
    for kind in MeshKind::ALL {
        assert_eq!(kind.name().parse(), Ok(kind));
        let made = generate_mesh(&small(kind)).expect("small");
        let mesh = mesh(&made);
        let volumes: Vec<f64> = (0..mesh.num_cells()).map(|c| volume(mesh, c)).collect();
        let sum: f64 = volumes.iter().map(|v| v.abs()).sum();
        let [tets, pyramids, wedges, hexes] = mesh.num_cells_by_type();
        let n = 8.0f64;
        let ball = 4.0 / 3.0 * std::f64::consts::PI;
        match kind {
            MeshKind::Tet100 | MeshKind::Jets => {
                assert_eq!((tets, mesh.num_cells()), (6 * 512, 6 * 512), "{kind}");
                assert!((sum - n.powi(3)).abs() < 1e-2, "{kind}: {sum}");
            }
            MeshKind::Hex150 => assert_eq!(hexes, 512),
            MeshKind::Delaunay => assert!(tets > 512 * 4 && sum < 512.0, "{tets} {sum}"),
            MeshKind::Lander => {
                assert_eq!((tets, wedges), (8 * 64 * 6 * 3, 8 * 64 * 2));
                // The polyhedron of flat triangles is a little smaller than the shell.
                let shell = ball * (4.0f64.powi(3) - 2.0f64.powi(3));
                assert!(sum < shell && sum > 0.93 * shell, "{sum} of {shell}");
            }
            MeshKind::Ocean => assert!(wedges > 50 && tets + hexes + pyramids == 0),
            MeshKind::Octree => {
                assert!(
                    hexes > 100 && pyramids > 20 && wedges > 20,
                    "{:?}",
                    mesh.num_cells_by_type()
                );
            }
        }
        if kind != MeshKind::Octree {
            assert!(volumes.iter().all(|&v| v > 0.0), "{kind}");
        }
        let again = generate_mesh(&small(kind)).expect("small");
        let bytes = |d: &Dataset| d.mesh().map(|m| m.connectivity().bytes().to_vec());
        assert_eq!(bytes(&made), bytes(&again), "{kind}");
    }
}

#[test]
fn what_is_asked_for_happens() {
    let plain = generate_mesh(&small(MeshKind::Jets)).expect("small");
    let spec = MeshSpec {
        values: MeshValues::Linear,
        jitter: 0.1,
        holes: 0.25,
        num_slivers: 17,
        shuffled: true,
        ..small(MeshKind::Jets)
    };
    let made = generate_mesh(&spec).expect("small");
    let (plain, disturbed) = (mesh(&plain), mesh(&made));
    assert_eq!(disturbed.num_points(), plain.num_points() + 17);
    let kept = disturbed.num_cells() - 17;
    let share = kept as f64 / plain.num_cells() as f64;
    assert!((share - 0.75).abs() < 0.05, "{share}");
    let flat = (0..disturbed.num_cells())
        .filter(|&c| volume(disturbed, c).abs() < 1e-5)
        .count();
    assert!(flat >= 17, "{flat}");
    let scalars = made.fields()[0].load().expect("made");
    for point in 0..disturbed.num_points() {
        let expected = linear_value(disturbed.position(point), spec.size);
        assert_eq!(scalars.get_f64(point, 0), expected);
    }
    assert!(generate_mesh(&MeshSpec { size: 0, ..spec }).is_err());
    let huge = MeshSpec {
        size: 1 << 40,
        ..spec
    };
    for kind in MeshKind::ALL {
        assert!(generate_mesh(&MeshSpec { kind, ..huge }).is_err(), "{kind}");
    }
}

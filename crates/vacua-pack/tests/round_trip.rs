//! What goes in comes out: the same cells, the same places, whatever the variant, bits and threads.

mod common;

use common::{CUTS, Cut, Random, Soup, canonical, lattice};
use proptest::prelude::*;
use vacua_pack::layout::{Child, WIDTH};
use vacua_pack::{EncodeError, EncodeOptions, Encoded, PackedMesh, Variant, encode};
use vacua_volume::{CellMask, CellType, UnstructuredMesh};

const VARIANTS: [Variant; 3] = [Variant::MultiLeaves, Variant::MultiNodes, Variant::Small];

fn encoded(mesh: &UnstructuredMesh, variant: Variant, index_bits: u32) -> Encoded {
    let options = EncodeOptions {
        variant,
        index_bits,
    };
    encode(mesh, options).expect("encodable")
}

/// Decodes all cells and compares them with the input by points, as multisets; checks the map of
/// cells, the positions, and that packed order grows.
fn check_cells(mesh: &UnstructuredMesh, encoded: &Encoded, left_out: &[usize]) {
    let packed = &encoded.mesh;
    let mut back = Vec::new();
    let mut last = None;
    for (i, cell) in packed.cells().enumerate() {
        let submesh = packed.submesh(cell.submesh as usize).expect("there");
        let points: Vec<u64> = cell
            .corners()
            .iter()
            .map(|&c| {
                encoded
                    .map
                    .points
                    .get((submesh.header.first_vertex + u64::from(c)) as usize)
            })
            .collect();
        for (&corner, &point) in cell.corners().iter().zip(&points) {
            let stored = submesh.position(corner).expect("there");
            let exact = mesh.position(point as usize).to_array();
            for axis in 0..3 {
                let off = exact[axis] - submesh.header.origin[axis] - f64::from(stored[axis]);
                assert!(off.abs() <= encoded.report.worst_rounding || off.is_nan());
            }
        }
        let found = canonical(cell.cell_type, &points);
        let original = mesh.cell(encoded.map.cells.get(i) as usize);
        assert_eq!(found, canonical(original.cell_type, original.points()));
        back.push(found);
        assert!(
            last < Some((cell.submesh, cell.index)),
            "packed order grows"
        );
        last = Some((cell.submesh, cell.index));
    }
    let mut expected: Vec<_> = (0..mesh.num_cells())
        .filter(|i| !left_out.contains(i))
        .map(|i| canonical(mesh.cell(i).cell_type, mesh.cell(i).points()))
        .collect();
    back.sort();
    expected.sort();
    assert_eq!(back, expected);
    assert_eq!(packed.num_cells(), expected.len() as u64);
}

/// The decoded box of every child, leaf or inner, contains all cells below it.
fn check_boxes(packed: &PackedMesh) {
    for s in 0..packed.submeshes().len() {
        let submesh = packed.submesh(s).expect("there");
        for number in 0..submesh.header.num_nodes {
            let (node, mut next) = submesh.node(number).expect("there");
            let mut at = u64::from(node.first_index);
            for k in 0..WIDTH {
                let (lo, hi) = node.child_box(k);
                let lo = submesh.grid.local_from_sixteenths(lo);
                let hi = submesh.grid.local_from_sixteenths(hi);
                let check = |_: u64, cell_type: CellType, corners: [u32; 8]| {
                    for &c in &corners[..cell_type.num_points()] {
                        let p = submesh.position(c).expect("there").map(f64::from);
                        assert!((0..3).all(|a| lo[a] <= p[a] && p[a] <= hi[a]));
                    }
                };
                match node.child(k) {
                    Child::Absent => {}
                    Child::Inner => {
                        assert!(next > number);
                        let mut stack = vec![next];
                        while let Some(below) = stack.pop() {
                            submesh.cells_of_node(below, check);
                            let (node, first) = submesh.node(below).expect("there");
                            let inner = (0..WIDTH).filter(|&k| node.child(k) == Child::Inner);
                            stack.extend(first..first + inner.count() as u32);
                        }
                        next += 1;
                    }
                    Child::Leaf(counts) => {
                        submesh.cells_of_leaf(at, counts, check);
                        at += counts.num_indices() as u64;
                    }
                }
            }
        }
    }
}

#[test]
fn every_kind_of_cell_comes_back() {
    for cut in CUTS {
        for variant in VARIANTS {
            let most = if variant == Variant::Small { 24 } else { 32 };
            for bits in [8, 11, 16, most] {
                let mesh = lattice(9, cut, 0.2, 5).mesh();
                let encoded = encoded(&mesh, variant, bits);
                check_cells(&mesh, &encoded, &[]);
                check_boxes(&encoded.mesh);
                for header in encoded.mesh.submeshes() {
                    let most = (1u64 << bits) - u64::from(header.has_marker());
                    assert!(u64::from(header.num_vertices) <= most);
                }
            }
        }
    }
}

#[test]
fn a_full_sub_mesh_uses_the_largest_index_unless_it_is_the_marker() {
    // 256 points in 32 hexahedra of their own: the last point has the marker's number.
    let mut soup = Soup::default();
    for i in 0..32u64 {
        let hex = lattice(1, Cut::Hexahedra, 0.0, 1).placed(1.0, [2.0 * i as f64, 0.0, 0.0]);
        soup.points.extend(hex.points);
        let corners = hex.cells[0].1.iter().map(|c| c + 8 * i).collect();
        soup.cells.push((CellType::Hexahedron, corners));
    }
    for variant in VARIANTS {
        let mesh = soup.mesh();
        let whole = encoded(&mesh, variant, 8);
        assert_eq!(whole.mesh.submeshes().len(), 1);
        assert_eq!(whole.mesh.submeshes()[0].num_vertices, 256);
        check_cells(&mesh, &whole, &[]);
        // One more cell on the same points, a pyramid, and one sub-mesh is not enough.
        let mut more = soup.clone();
        more.cells.push((CellType::Pyramid, vec![0, 1, 3, 2, 4]));
        let mesh = more.mesh();
        let split = encoded(&mesh, variant, 8);
        assert!(split.mesh.submeshes().len() > 1);
        check_cells(&mesh, &split, &[]);
    }
}

#[test]
fn degenerate_inverted_and_doubled_cells_survive() {
    let mut soup = lattice(4, Cut::Tetrahedra, 0.2, 3);
    let hexes = lattice(4, Cut::Hexahedra, 0.2, 3);
    let mut random = Random(9);
    for (i, cell) in hexes.cells.iter().enumerate() {
        let mut corners = cell.1.clone();
        match i % 4 {
            // Hexahedra with the points of a wedge, a pyramid, a tetrahedron, one point.
            0 => (corners[3], corners[7]) = (corners[2], corners[6]),
            1 => corners[5..].fill(cell.1[4]),
            2 => corners[2..].fill(cell.1[4]),
            _ => corners.fill(cell.1[0]),
        }
        soup.cells.push((CellType::Hexahedron, corners));
    }
    for i in 0..soup.cells.len() {
        let (cell_type, mut corners) = soup.cells[i].clone();
        match i % 5 {
            0 => corners.swap(0, 1),
            1 if cell_type == CellType::Tetrahedron => corners[1] = corners[0],
            _ => {}
        }
        soup.cells.push((cell_type, corners));
    }
    random.shuffle(&mut soup.cells);
    for variant in VARIANTS {
        let mesh = soup.mesh();
        let encoded = encoded(&mesh, variant, 16);
        check_cells(&mesh, &encoded, &[]);
        check_boxes(&encoded.mesh);
    }
}

#[test]
fn inverted_tets_are_never_paired() {
    let mut soup = lattice(5, Cut::Tetrahedra, 0.1, 3);
    soup.cells.iter_mut().for_each(|c| c.1.swap(2, 3));
    let encoded = encoded(&soup.mesh(), Variant::MultiNodes, 16);
    assert_eq!(encoded.report.totals.pairs, 0);
    assert_eq!(encoded.report.totals.tets, 750);
}

#[test]
fn blanked_and_unplaced_cells_are_left_out_and_counted() {
    let mut soup = lattice(5, Cut::Mixed, 0.1, 3);
    let victim = soup.cells[7].1[0] as usize;
    soup.points[victim][1] = f64::NAN;
    let not_finite: Vec<usize> = (0..soup.cells.len())
        .filter(|&i| soup.cells[i].1.contains(&(victim as u64)))
        .collect();
    let blanked = (0..soup.cells.len())
        .find(|i| !not_finite.contains(i))
        .expect("one");
    let mut mask = CellMask::new(soup.cells.len());
    mask.blank(blanked);
    let mesh = soup.mesh().with_blanked_cells(mask).expect("fits");
    let encoded = encoded(&mesh, Variant::MultiNodes, 16);
    assert_eq!(encoded.report.num_blanked, 1);
    assert_eq!(encoded.report.num_not_finite, not_finite.len());
    check_cells(&mesh, &encoded, &[not_finite, vec![blanked]].concat());
}

#[test]
fn nothing_encodes_to_nothing() {
    for variant in VARIANTS {
        let encoded = encoded(&Soup::default().mesh(), variant, 16);
        assert_eq!(encoded.mesh.num_cells(), 0);
        assert_eq!(encoded.mesh.cells().count(), 0);
        assert_eq!(encoded.mesh.locator().locate([0.0; 3]), None);
        assert!(encoded.mesh.bounds().is_none());
    }
    for index_bits in [0, 7, 33] {
        let options = EncodeOptions {
            index_bits,
            ..EncodeOptions::default()
        };
        let error = encode(&Soup::default().mesh(), options).err();
        let expected = EncodeError::IndexBits {
            actual: index_bits,
            most: 32,
        };
        assert_eq!(error, Some(expected));
    }
    let options = EncodeOptions {
        variant: Variant::Small,
        index_bits: 25,
    };
    let error = encode(&Soup::default().mesh(), options).err();
    let expected = EncodeError::IndexBits {
        actual: 25,
        most: 24,
    };
    assert_eq!(error, Some(expected));
}

#[test]
fn a_small_mesh_far_away_keeps_its_digits() {
    let soup = lattice(4, Cut::Mixed, 0.2, 8).placed(1e-3, [4e6, -5e6, 300.0]);
    let mesh = soup.wide_mesh();
    let encoded = encoded(&mesh, Variant::MultiNodes, 16);
    assert!(
        encoded.report.worst_rounding < 1e-9,
        "{}",
        encoded.report.worst_rounding
    );
    check_cells(&mesh, &encoded, &[]);
    // Positions that f32 holds are kept as they are, without an origin.
    let exact = lattice(4, Cut::Mixed, 0.0, 8).wide_mesh();
    let encoded = self::encoded(&exact, Variant::MultiNodes, 16);
    assert_eq!(encoded.report.worst_rounding, 0.0);
    assert!(
        encoded
            .mesh
            .submeshes()
            .iter()
            .all(|s| s.origin == [0.0; 3])
    );
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let mesh = lattice(30, Cut::Mixed, 0.2, 4).mesh();
    for variant in VARIANTS {
        let bytes = [1, 2, 5].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let encoded = pool
                .expect("threads")
                .install(|| encoded(&mesh, variant, 10));
            let m = &encoded.mesh;
            assert!(m.submeshes().len() > 20);
            [
                bytemuck::cast_slice(m.submeshes()).to_vec(),
                m.nodes().bytes().to_vec(),
                bytemuck::cast_slice(m.outer()).to_vec(),
                bytemuck::cast_slice(m.positions()).to_vec(),
                m.clusters().map_or(Vec::new(), |c| c.bytes().concat()),
                m.cells()
                    .flat_map(|c| c.corners)
                    .flat_map(u32::to_le_bytes)
                    .collect(),
                (0..encoded.map.cells.len())
                    .flat_map(|i| encoded.map.cells.get(i).to_le_bytes())
                    .collect::<Vec<u8>>(),
            ]
        });
        assert_eq!(bytes[0], bytes[1]);
        assert_eq!(bytes[0], bytes[2]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Any soup of cells: random points, random corners, repetitions and all.
    #[test]
    fn any_soup_comes_back(
        seed in any::<u64>(),
        num_points in 1usize..60,
        num_cells in 0usize..400,
        bits in 8u32..=18,
        power in prop::sample::select(vec![-30, -9, 0, 9, 30]),
        variant in prop::sample::select(VARIANTS.to_vec()),
        flat in any::<bool>(),
    ) {
        let mut random = Random(seed);
        let mut soup = Soup::default();
        for _ in 0..num_points {
            let mut c = || random.between(-1.0, 1.0) * 10f64.powi(power);
            soup.points.push([c(), c(), if flat { 0.0 } else { c() }]);
        }
        for _ in 0..num_cells {
            let cell_type = CellType::ALL[(random.next() % 4) as usize];
            let corners = (0..cell_type.num_points()).map(|_| random.next() % num_points as u64);
            soup.cells.push((cell_type, corners.collect()));
        }
        let mesh = soup.mesh();
        let encoded = encoded(&mesh, variant, bits);
        check_cells(&mesh, &encoded, &[]);
        check_boxes(&encoded.mesh);
    }
}

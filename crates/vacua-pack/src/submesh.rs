//! Encoding one sub-mesh: leaves of tetrahedra, pairs and others, the tree over them, its nodes.
//!
//! Source: paper B, §4.1 and §5.1 to §5.7.

use vacua_volume::CellType;

use crate::bvh::{self, Below, BinaryNode, Box4, LeafMaker, Prim};
use crate::collapse::{WideNode, multi_leaves, multi_nodes};
use crate::grid::Grid;
use crate::ids::{Ids, Numbering};
use crate::input::Input;
use crate::layout::{
    LeafCounts, MAX_LEAF_OTHERS, MAX_LEAF_PAIRS, MAX_LEAF_TETS, MultiLeaf, MultiNode,
    OTHER_INDICES, SubmeshHeader, WIDTH,
};
use crate::pairs::{bits, match_pairs};
use crate::{EncodeError, Variant, indices};

/// What testing a tetrahedron costs, in primitives. The heuristic counts cells before they are
/// paired, and most tetrahedra end up as half of a pair, which is one primitive of 5 indices: this is
/// what such a half reads of a tetrahedron's 4. With 1 a Delaunay mesh has 4.7 cells a leaf and takes
/// 10.5 bytes a cell in variant 2, with this 6.9 and 9.5.
const TET_COST: f32 = 0.625;

/// Stands for the marker until the number of bits is applied.
const MARKER: u32 = u32::MAX;

/// A sub-mesh whose places in the common arrays are still to be given.
pub struct EncodedSubmesh {
    /// Everything but the `first_…`.
    pub header: SubmeshHeader,
    /// Positions of its vertices, relative to the origin.
    pub positions: Vec<[f32; 3]>,
    /// Which points of the input its vertices are.
    pub points: Ids,
    /// Which cells of the input its cells are, in packed order.
    pub cells: Ids,
    /// Its indices, packed.
    pub indices: Vec<u8>,
    /// Its nodes in variant 1.
    pub multi_leaves: Vec<MultiLeaf>,
    /// Its nodes in variant 2.
    pub multi_nodes: Vec<MultiNode>,
    /// How many primitives there are.
    pub num_primitives: LeafTotals,
}

/// Primitives, leaves and nodes of a sub-mesh, or of several.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeafTotals {
    /// Tetrahedra on their own.
    pub tets: u64,
    /// Pairs of tetrahedra.
    pub pairs: u64,
    /// Pyramids, wedges and hexahedra.
    pub others: u64,
    /// Leaves.
    pub leaves: u64,
    /// Children of all nodes.
    pub children: u64,
}

impl LeafTotals {
    /// The sum.
    pub fn plus(self, other: Self) -> Self {
        Self {
            tets: self.tets + other.tets,
            pairs: self.pairs + other.pairs,
            others: self.others + other.others,
            leaves: self.leaves + other.leaves,
            children: self.children + other.children,
        }
    }
}

/// The cells of a sub-mesh with points numbered from 0 as they are first seen.
struct Gathered {
    points: Vec<u64>,
    positions: Vec<[f32; 4]>,
    types: Vec<CellType>,
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl Gathered {
    fn new(input: &Input, cells: &[u64]) -> Self {
        let mut numbering = Numbering::new();
        let mut gathered = Self {
            points: Vec::new(),
            positions: Vec::new(),
            types: Vec::with_capacity(cells.len()),
            starts: Vec::with_capacity(cells.len() + 1),
            corners: Vec::with_capacity(cells.len() * 4),
        };
        for &cell in cells {
            let (cell_type, points) = input.cell(cell);
            gathered.types.push(cell_type);
            gathered.starts.push(gathered.corners.len() as u32);
            let corners = points.as_slice().iter().map(|&p| numbering.number(p));
            gathered.corners.extend(corners);
        }
        gathered.starts.push(gathered.corners.len() as u32);
        gathered.points = numbering.points().to_vec();
        let position = |&point: &u64| {
            let [x, y, z] = input.local(point);
            [x, y, z, 0.0]
        };
        gathered.positions = gathered.points.iter().map(position).collect();
        gathered
    }

    /// What testing a cell costs on average.
    fn mean_cost(&self) -> f32 {
        let tets = self.types.iter().filter(|&&t| t == CellType::Tetrahedron);
        let tets = tets.count() as f32 / self.types.len() as f32;
        1.0 - tets * (1.0 - TET_COST)
    }

    fn corners(&self, cell: usize) -> &[u32] {
        &self.corners[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    fn bounds(&self, cell: usize) -> Box4 {
        let corners = self.corners(cell).iter();
        corners.fold(Box4::EMPTY, |b, &v| {
            b.with_point(self.positions[v as usize])
        })
    }

    /// Whether a tetrahedron has positive volume.
    fn is_upright(&self, [a, b, c, d]: [u32; 4]) -> bool {
        let at = |v: u32| self.positions[v as usize].map(f64::from);
        let (p, q, r, s) = (at(a), at(b), at(c), at(d));
        let from = |x: [f64; 4]| [x[0] - p[0], x[1] - p[1], x[2] - p[2]];
        let (u, v, w) = (from(q), from(r), from(s));
        let volume = u[0] * (v[1] * w[2] - v[2] * w[1])
            + u[1] * (v[2] * w[0] - v[0] * w[2])
            + u[2] * (v[0] * w[1] - v[1] * w[0]);
        volume > 0.0
    }
}

/// A leaf's counts and where its indices and cells start.
struct Leaf {
    counts: LeafCounts,
    first_word: u32,
    first_cell: u32,
}

/// Makes leaves that fit the counters.
struct CellLeaves<'a> {
    gathered: &'a Gathered,
    mean_cost: f32,
    upright: Vec<bool>,
    leaves: Vec<Leaf>,
    words: Vec<u32>,
    cells: Vec<u32>,
}

impl LeafMaker for CellLeaves<'_> {
    const MAX_PRIMS: usize = MAX_LEAF_TETS + 2 * MAX_LEAF_PAIRS + MAX_LEAF_OTHERS;

    fn primitive_cost(&self) -> f32 {
        self.mean_cost
    }

    fn leaf(&mut self, prims: &[Prim]) -> Option<u32> {
        let mut tets = [[0; 4]; Self::MAX_PRIMS];
        let mut tet_cells = [0; Self::MAX_PRIMS];
        let mut upright = [false; Self::MAX_PRIMS];
        let mut others = [0; MAX_LEAF_OTHERS];
        let (mut num_tets, mut num_others) = (0, 0);
        for prim in prims {
            let cell = prim.number();
            if let [a, b, c, d] = *self.gathered.corners(cell as usize) {
                tets[num_tets] = [a, b, c, d];
                tet_cells[num_tets] = cell;
                upright[num_tets] = self.upright[cell as usize];
                num_tets += 1;
            } else {
                *others.get_mut(num_others)? = cell;
                num_others += 1;
            }
        }
        let mut pairs = [([0; 2], [0; 5]); Self::MAX_PRIMS / 2];
        let mut num_pairs = 0;
        let single = match_pairs(&tets[..num_tets], &upright[..num_tets], |i, j, five| {
            pairs[num_pairs] = ([i, j], five);
            num_pairs += 1;
        });
        let counts = LeafCounts {
            tets: single.count_ones() as u8,
            pairs: num_pairs as u8,
            others: num_others as u8,
        };
        counts.pack()?;
        let (first_word, first_cell) = (self.words.len() as u32, self.cells.len() as u32);
        for i in bits(single) {
            self.words.extend(tets[i]);
            self.cells.push(tet_cells[i]);
        }
        for (both, five) in &pairs[..num_pairs] {
            self.words.extend(five);
            self.cells.extend(both.map(|i| tet_cells[i]));
        }
        for &cell in &others[..num_others] {
            let corners = self.gathered.corners(cell as usize);
            self.words.extend(corners);
            self.words
                .extend(std::iter::repeat_n(MARKER, OTHER_INDICES - corners.len()));
            self.cells.push(cell);
        }
        self.leaves.push(Leaf {
            counts,
            first_word,
            first_cell,
        });
        Some((self.leaves.len() - 1) as u32)
    }
}

/// Encodes the cells of one sub-mesh: at least one, all finite, few enough for the bits.
///
/// # Errors
/// [`EncodeError::TooManyIndices`] if 32-bit offsets do not reach.
pub fn encode(
    input: &Input,
    cells: &[u64],
    variant: Variant,
    index_bits: u32,
) -> Result<EncodedSubmesh, EncodeError> {
    let gathered = Gathered::new(input, cells);
    let mut prims: Vec<Prim> = (0..cells.len())
        .map(|i| Prim::new(i as u32, gathered.bounds(i)))
        .collect();
    let upright = (0..cells.len()).map(|i| match *gathered.corners(i) {
        [a, b, c, d] => gathered.is_upright([a, b, c, d]),
        _ => false,
    });
    let mut maker = CellLeaves {
        gathered: &gathered,
        mean_cost: gathered.mean_cost(),
        upright: upright.collect(),
        leaves: Vec::with_capacity(cells.len() / 4),
        words: Vec::with_capacity(gathered.corners.len()),
        cells: Vec::with_capacity(cells.len()),
    };
    let nodes = bvh::build(&mut prims, &mut maker);
    drop(prims);
    if u32::try_from(maker.words.len()).is_err() {
        return Err(EncodeError::TooManyIndices {
            cells: cells.len() as u64,
            indices: maker.words.len() as u64,
        });
    }
    let wide = match variant {
        Variant::MultiLeaves => multi_leaves(&nodes),
        Variant::MultiNodes => multi_nodes(&nodes),
    };
    let mut emitter = Emitter::new(input, cells, &maker, &nodes, index_bits);
    for node in &wide {
        let leaf = emitter.node(node);
        match variant {
            Variant::MultiLeaves => emitter.out.multi_leaves.push(leaf),
            Variant::MultiNodes => emitter.out.multi_nodes.push(MultiNode {
                leaf,
                first_child: node.first_child,
            }),
        }
    }
    Ok(emitter.finish(wide.len()))
}

/// Writes nodes and their primitives in final order and gives vertices their final numbers.
struct Emitter<'a> {
    input: &'a Input<'a>,
    cells: &'a [u64],
    maker: &'a CellLeaves<'a>,
    nodes: &'a [BinaryNode],
    grid: Grid,
    marker: u32,
    final_number: Vec<u32>,
    index_bits: u32,
    words: Vec<u32>,
    out: EncodedSubmesh,
}

impl<'a> Emitter<'a> {
    fn new(
        input: &'a Input<'a>,
        cells: &'a [u64],
        maker: &'a CellLeaves<'a>,
        nodes: &'a [BinaryNode],
        index_bits: u32,
    ) -> Self {
        let gathered = maker.gathered;
        let bounds = nodes[nodes.len() - 1].bounds;
        let grid = Grid::new(bounds.lo3(), bounds.hi3());
        let mut num_cells = [0; 4];
        for &cell_type in &gathered.types {
            num_cells[cell_type as usize] += 1;
        }
        let header = SubmeshHeader {
            origin: input.origin,
            grid_base: grid.base,
            grid_exponent: grid.exponent,
            num_vertices: gathered.points.len() as u32,
            num_cells,
            lo: bounds.lo3(),
            hi: bounds.hi3(),
            ..bytemuck::Zeroable::zeroed()
        };
        let num_points = input.mesh().num_points() as u64;
        let num_input_cells = input.mesh().num_cells() as u64;
        Self {
            input,
            cells,
            maker,
            nodes,
            grid,
            marker: u32::MAX >> (32 - index_bits),
            final_number: vec![u32::MAX; gathered.points.len()],
            index_bits,
            words: Vec::with_capacity(maker.words.len()),
            out: EncodedSubmesh {
                header,
                positions: Vec::with_capacity(gathered.points.len()),
                points: Ids::below(num_points, gathered.points.len()),
                cells: Ids::below(num_input_cells, cells.len()),
                indices: Vec::new(),
                multi_leaves: Vec::new(),
                multi_nodes: Vec::new(),
                num_primitives: LeafTotals::default(),
            },
        }
    }

    fn node(&mut self, wide: &WideNode) -> MultiLeaf {
        let bounds = self.nodes[wide.node as usize].bounds;
        let (lo, hi) = self.grid.quantise(bounds.lo3(), bounds.hi3());
        let mut node = MultiLeaf {
            lo,
            hi,
            first_index: self.words.len() as u32,
            ..MultiLeaf::EMPTY
        };
        for (k, &child) in wide.children.as_slice().iter().enumerate().take(WIDTH) {
            let child = &self.nodes[child as usize];
            node.set_child_box(k, &self.grid, child.bounds.lo3(), child.bounds.hi3());
            self.out.num_primitives.children += 1;
            if let Below::Leaf(leaf) = child.below {
                node.counts[k] = self.leaf(leaf as usize);
            }
        }
        node
    }

    fn leaf(&mut self, leaf: usize) -> u8 {
        let (maker, out) = (self.maker, &mut self.out);
        let leaf = &maker.leaves[leaf];
        let first = leaf.first_word as usize;
        for &word in &maker.words[first..first + leaf.counts.num_indices()] {
            if word == MARKER {
                self.words.push(self.marker);
                continue;
            }
            let number = &mut self.final_number[word as usize];
            if *number == u32::MAX {
                *number = out.positions.len() as u32;
                let point = maker.gathered.points[word as usize];
                out.positions.push(self.input.local(point));
                out.points.push(point);
            }
            self.words.push(*number);
        }
        let first = leaf.first_cell as usize;
        for &cell in &maker.cells[first..first + leaf.counts.num_cells()] {
            out.cells.push(self.cells[cell as usize]);
        }
        out.num_primitives = out.num_primitives.plus(LeafTotals {
            tets: u64::from(leaf.counts.tets),
            pairs: u64::from(leaf.counts.pairs),
            others: u64::from(leaf.counts.others),
            leaves: 1,
            children: 0,
        });
        leaf.counts.pack().unwrap_or(0)
    }

    fn finish(mut self, num_nodes: usize) -> EncodedSubmesh {
        self.out.header.num_nodes = num_nodes as u32;
        self.out.header.num_indices = self.words.len() as u64;
        indices::pack(&self.words, self.index_bits, &mut self.out.indices);
        self.out
    }
}

//! A binary bounding volume hierarchy by the surface area heuristic: what multi-nodes are made of.
//!
//! Source: paper B, §5.7. A traversal step costs as much as [`TRAVERSAL_COST`] primitives, of which a
//! pair of tetrahedra is one ([`LeafMaker::primitive_cost`]). A node
//! becomes a leaf when no split is cheaper *and* whoever builds can encode such a leaf; otherwise it
//! is split all the same. Sixteen bins an axis for many primitives (a sample of them for very many),
//! every place for few.
//! Deterministic: the result depends on the primitives and their order alone.

/// What a traversal step costs, in primitives.
pub const TRAVERSAL_COST: f32 = 2.0;
/// Deeper than this, nodes split in the middle of their list, which bounds the depth by
/// this + log2(primitives).
const MAX_SAH_DEPTH: usize = 48;
/// Bins an axis.
const BINS: usize = 16;
/// Of more primitives than this only every second, third … is binned, at least so many of them.
const MIN_SAMPLES: usize = 4096;
/// Up to so many primitives every place to split is tried.
const MAX_SWEEP: usize = 32;

/// A box of four lanes, the last unused: the compiler makes one vector of it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(16))]
pub struct Box4 {
    /// Lower corner.
    pub lo: [f32; 4],
    /// Upper corner.
    pub hi: [f32; 4],
}

impl Box4 {
    /// What any box replaces.
    pub const EMPTY: Self = Self {
        lo: [f32::INFINITY; 4],
        hi: [f32::NEG_INFINITY; 4],
    };

    /// The smallest box around both.
    #[inline(always)]
    pub fn union(&self, other: &Self) -> Self {
        let mut result = *self;
        for i in 0..4 {
            result.lo[i] = if other.lo[i] < result.lo[i] {
                other.lo[i]
            } else {
                result.lo[i]
            };
            result.hi[i] = if other.hi[i] > result.hi[i] {
                other.hi[i]
            } else {
                result.hi[i]
            };
        }
        result
    }

    /// The smallest box around this and a point.
    #[inline(always)]
    pub fn with_point(&self, p: [f32; 4]) -> Self {
        self.union(&Self { lo: p, hi: p })
    }

    /// Half the surface.
    #[inline(always)]
    fn half_area(&self) -> f32 {
        let d = [
            self.hi[0] - self.lo[0],
            self.hi[1] - self.lo[1],
            self.hi[2] - self.lo[2],
        ];
        d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
    }

    /// Lower corner.
    pub fn lo3(&self) -> [f32; 3] {
        [self.lo[0], self.lo[1], self.lo[2]]
    }

    /// Upper corner.
    pub fn hi3(&self) -> [f32; 3] {
        [self.hi[0], self.hi[1], self.hi[2]]
    }
}

/// A primitive: its box, and its number, sixteen bits in each of the fourth lanes. They are whole
/// numbers there: as bits they would be subnormal numbers, on which arithmetic is fifty times slower.
#[derive(Clone, Copy, Debug)]
pub struct Prim(Box4);

impl Prim {
    /// A primitive with a box.
    pub fn new(number: u32, bounds: Box4) -> Self {
        let mut b = bounds;
        b.lo[3] = (number & 0xFFFF) as f32;
        b.hi[3] = (number >> 16) as f32;
        Self(b)
    }

    /// The number it was given.
    #[inline(always)]
    pub fn number(&self) -> u32 {
        self.0.lo[3] as u32 | (self.0.hi[3] as u32) << 16
    }

    /// Its box; the fourth lane means nothing.
    #[inline(always)]
    pub fn bounds(&self) -> &Box4 {
        &self.0
    }

    /// Twice its centre, scaled down so that it stays finite.
    #[inline(always)]
    fn center(&self) -> [f32; 4] {
        let (lo, hi) = (self.0.lo, self.0.hi);
        [
            0.25 * lo[0] + 0.25 * hi[0],
            0.25 * lo[1] + 0.25 * hi[1],
            0.25 * lo[2] + 0.25 * hi[2],
            0.25 * lo[3] + 0.25 * hi[3],
        ]
    }
}

/// What a binary node has below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Below {
    /// Two nodes.
    Nodes(u32, u32),
    /// A leaf, by the number that its maker gave.
    Leaf(u32),
}

/// A node of the binary tree.
#[derive(Clone, Copy, Debug)]
pub struct BinaryNode {
    /// Box around all its primitives.
    pub bounds: Box4,
    /// What is below.
    pub below: Below,
}

/// Whoever builds decides which leaves there can be.
pub trait LeafMaker {
    /// No leaf has more primitives.
    const MAX_PRIMS: usize;
    /// What testing one costs on average, in the units of [`TRAVERSAL_COST`].
    fn primitive_cost(&self) -> f32 {
        1.0
    }
    /// Makes a leaf of these primitives and returns its number, or `None` if it cannot. Must succeed
    /// for one primitive.
    fn leaf(&mut self, prims: &[Prim]) -> Option<u32>;
}

/// Builds the tree over at least one primitive, which it reorders. Children come before their
/// parents, the root is last.
pub fn build<M: LeafMaker>(prims: &mut [Prim], maker: &mut M) -> Vec<BinaryNode> {
    let mut nodes = Vec::with_capacity(prims.len() / 2 + 2);
    Builder {
        maker,
        nodes: &mut nodes,
    }
    .build(prims, 0);
    nodes
}

struct Builder<'a, M> {
    maker: &'a mut M,
    nodes: &'a mut Vec<BinaryNode>,
}

impl<M: LeafMaker> Builder<'_, M> {
    fn build(&mut self, prims: &mut [Prim], depth: usize) -> u32 {
        let mut bounds = Box4::EMPTY;
        let mut centers = Box4::EMPTY;
        for p in prims.iter() {
            bounds = bounds.union(p.bounds());
            centers = centers.with_point(p.center());
        }
        let split = match prims.len() {
            0 | 1 => None,
            _ if depth >= MAX_SAH_DEPTH => Some((f32::INFINITY, prims.len() / 2)),
            n if n <= MAX_SWEEP => Some(sweep(prims, &bounds)),
            _ => Some(binned(prims, &bounds, &centers)),
        };
        let leaf_primitives = prims.len() as f32;
        let step = TRAVERSAL_COST / self.maker.primitive_cost();
        let wants_leaf = split.is_none_or(|(after, _)| step + after >= leaf_primitives);
        if wants_leaf
            && prims.len() <= M::MAX_PRIMS
            && let Some(leaf) = self.maker.leaf(prims)
        {
            return self.push(bounds, Below::Leaf(leaf));
        }
        let middle = split.map_or(prims.len() / 2, |(_, middle)| middle);
        let (left, right) = prims.split_at_mut(middle);
        let left = self.build(left, depth + 1);
        let right = self.build(right, depth + 1);
        self.push(bounds, Below::Nodes(left, right))
    }

    fn push(&mut self, bounds: Box4, below: Below) -> u32 {
        self.nodes.push(BinaryNode { bounds, below });
        (self.nodes.len() - 1) as u32
    }
}

/// Primitives still to be tested after a split into boxes of these areas and counts, on average. A
/// flat parent (area 0) is never worth splitting.
#[inline(always)]
fn tests_after_split(weighted_areas: f32, parent_area: f32) -> f32 {
    let tests = weighted_areas / parent_area;
    if tests.is_nan() { f32::INFINITY } else { tests }
}

/// Orders the primitives along the best axis and gives the tests left after the best split,
/// and its place.
fn sweep(prims: &mut [Prim], bounds: &Box4) -> (f32, usize) {
    let n = prims.len();
    let mut best = (f32::INFINITY, n / 2, 0);
    let mut orders = [[0u64; MAX_SWEEP]; 3];
    let mut right = [0.0f32; MAX_SWEEP];
    for (axis, order) in orders.iter_mut().enumerate() {
        let order = &mut order[..n];
        for (i, (key, p)) in order.iter_mut().zip(prims.iter()).enumerate() {
            *key = u64::from(sortable(p.center()[axis])) << 32 | i as u64;
        }
        order.sort_unstable();
        let at = |k: usize| prims[(order[k] & 0xFFFF_FFFF) as usize].bounds();
        let mut b = Box4::EMPTY;
        for k in (1..n).rev() {
            b = b.union(at(k));
            right[k] = b.half_area() * (n - k) as f32;
        }
        let mut b = Box4::EMPTY;
        for k in 1..n {
            b = b.union(at(k - 1));
            let weighted = b.half_area() * k as f32 + right[k];
            if weighted < best.0 {
                best = (weighted, k, axis);
            }
        }
    }
    let mut sorted = [prims[0]; MAX_SWEEP];
    for (to, key) in sorted.iter_mut().zip(&orders[best.2][..n]) {
        *to = prims[(key & 0xFFFF_FFFF) as usize];
    }
    prims.copy_from_slice(&sorted[..n]);
    (tests_after_split(best.0, bounds.half_area()), best.1)
}

/// Bits that order as the numbers do.
#[inline(always)]
fn sortable(value: f32) -> u32 {
    let bits = value.to_bits();
    bits ^ ((bits as i32 >> 31) as u32 | 0x8000_0000)
}

/// Partitions the primitives by the best of the planes between bins; gives the tests left
/// after it, and its place.
fn binned(prims: &mut [Prim], bounds: &Box4, centers: &Box4) -> (f32, usize) {
    let n = prims.len();
    // A factor that keeps the largest centre in the last bin.
    let scale = [0, 1, 2].map(|axis| {
        let scale = BINS as f32 * 0.999_99 / (centers.hi[axis] - centers.lo[axis]);
        if scale.is_finite() { scale } else { 0.0 }
    });
    let base = centers.lo;
    let bin_of = |p: &Prim, axis: usize| {
        (((p.center()[axis] - base[axis]) * scale[axis]) as usize).min(BINS - 1)
    };
    let mut bins = [[(Box4::EMPTY, 0u32); BINS]; 3];
    for p in prims.iter().step_by((n / MIN_SAMPLES).max(1)) {
        for (axis, bins) in bins.iter_mut().enumerate() {
            let bin = &mut bins[bin_of(p, axis)];
            bin.0 = bin.0.union(p.bounds());
            bin.1 += 1;
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for (axis, bins) in bins.iter().enumerate() {
        let mut right = [(0.0f32, 0u32); BINS];
        let (mut b, mut count) = (Box4::EMPTY, 0);
        for k in (1..BINS).rev() {
            b = b.union(&bins[k].0);
            count += bins[k].1;
            right[k] = (
                if count > 0 {
                    b.half_area() * count as f32
                } else {
                    0.0
                },
                count,
            );
        }
        let (mut b, mut count) = (Box4::EMPTY, 0);
        for k in 1..BINS {
            b = b.union(&bins[k - 1].0);
            count += bins[k - 1].1;
            if count == 0 || right[k].1 == 0 {
                continue;
            }
            let weighted = b.half_area() * count as f32 + right[k].0;
            if weighted < best.0 {
                best = (weighted, axis, k);
            }
        }
    }
    let (weighted, axis, plane) = best;
    if plane == 0 {
        return (f32::INFINITY, n / 2);
    }
    let middle = partition(prims, |p| bin_of(p, axis) < plane);
    (tests_after_split(weighted, bounds.half_area()), middle)
}

/// Moves those for which `is_left` holds to the front and returns their number.
pub fn partition<T>(items: &mut [T], mut is_left: impl FnMut(&T) -> bool) -> usize {
    let (mut i, mut j) = (0, items.len());
    loop {
        while i < j && is_left(&items[i]) {
            i += 1;
        }
        while i < j && !is_left(&items[j - 1]) {
            j -= 1;
        }
        if i >= j {
            return i;
        }
        items.swap(i, j - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct Lists {
        most: usize,
        lists: Vec<Vec<u32>>,
    }

    impl LeafMaker for Lists {
        const MAX_PRIMS: usize = 33;
        fn leaf(&mut self, prims: &[Prim]) -> Option<u32> {
            (prims.len() <= self.most).then(|| {
                self.lists.push(prims.iter().map(Prim::number).collect());
                (self.lists.len() - 1) as u32
            })
        }
    }

    fn check(boxes: &[Box4], most: usize) {
        let mut prims: Vec<Prim> = (0..).zip(boxes).map(|(i, &b)| Prim::new(i, b)).collect();
        let mut maker = Lists {
            most,
            lists: Vec::new(),
        };
        let nodes = build(&mut prims, &mut maker);
        let mut seen = vec![0; boxes.len()];
        let mut referenced = vec![0; nodes.len()];
        for node in &nodes {
            let contains = |b: &Box4| {
                (0..3).all(|i| node.bounds.lo[i] <= b.lo[i] && b.hi[i] <= node.bounds.hi[i])
            };
            match node.below {
                Below::Leaf(leaf) => {
                    for &p in &maker.lists[leaf as usize] {
                        seen[p as usize] += 1;
                        assert!(contains(&boxes[p as usize]));
                    }
                }
                Below::Nodes(a, b) => {
                    for child in [a, b] {
                        referenced[child as usize] += 1;
                        assert!(contains(&nodes[child as usize].bounds));
                    }
                }
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
        assert_eq!(referenced.pop(), Some(0), "the root is last");
        assert!(referenced.iter().all(|&n| n == 1));
    }

    #[test]
    fn equal_and_flat_boxes_build_in_bounded_depth() {
        let same = Box4 {
            lo: [1.0; 4],
            hi: [1.0; 4],
        };
        check(&vec![same; 100_000], 3);
        let line: Vec<Box4> = (0..5000)
            .map(|i| {
                let x = 0.5f32.powi(i / 40);
                Box4 {
                    lo: [x, 0.0, 0.0, 0.0],
                    hi: [x, 0.0, 0.0, 0.0],
                }
            })
            .collect();
        check(&line, 1);
    }

    proptest! {
        #[test]
        fn every_primitive_is_in_one_leaf_and_boxes_contain(
            corners in prop::collection::vec(prop::array::uniform6(-1e30f32..1e30), 1..300),
            most in 1usize..33,
        ) {
            let boxes: Vec<Box4> = corners.iter().map(|c| {
                Box4::EMPTY
                    .with_point([c[0], c[1], c[2], 0.0])
                    .with_point([c[3], c[4], c[5], 0.0])
            }).collect();
            check(&boxes, most);
        }
    }
}

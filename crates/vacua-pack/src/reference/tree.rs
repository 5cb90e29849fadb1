//! Hierarchies as the library builds them, in an order that suits whoever copies them: children after
//! their parents, two and two side by side.

use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;

/// Lower and upper corner.
pub(super) type Box3 = [[f32; 3]; 2];

/// What is below a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Below {
    /// Two nodes, the first of them.
    Nodes(u32),
    /// Items from a place in the list on.
    Items(u32, u32),
}

/// A node of a binary hierarchy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub bounds: Box3,
    pub below: Below,
}

/// A binary hierarchy.
pub(super) struct Tree {
    /// The root is first; empty without any item.
    pub nodes: Vec<Node>,
    /// Numbers of the items, leaf after leaf.
    pub items: Vec<u32>,
}

/// Builds a hierarchy over boxes, one in a leaf.
pub(super) fn build(boxes: &[Box3]) -> Tree {
    let mut tree = Tree {
        nodes: Vec::new(),
        items: Vec::with_capacity(boxes.len()),
    };
    if boxes.is_empty() {
        return tree;
    }
    let boxes: Vec<Aabb> = boxes
        .iter()
        .map(|[lo, hi]| Aabb::new((*lo).into(), (*hi).into()))
        .collect();
    let parameters = BvhBuildParams {
        max_prims_per_leaf: 1,
        ..BvhBuildParams::medium_build()
    };
    let mut secs = std::time::Duration::ZERO;
    let bvh = build_bvh2(&boxes, parameters, &mut secs);
    drop(boxes);
    tree.nodes.reserve_exact(bvh.nodes.len());
    // Depth first: what is close in space is close in memory. Places, and the library's numbers.
    let mut stack = vec![(0, 0u32)];
    tree.push(&bvh, 0);
    while let Some((next, library)) = stack.pop() {
        let node = &bvh.nodes[library as usize];
        if node.prim_count > 0 {
            let first = tree.items.len() as u32;
            let place = node.first_index as usize;
            let items = &bvh.primitive_indices[place..place + node.prim_count as usize];
            tree.items.extend_from_slice(items);
            tree.nodes[next].below = Below::Items(first, node.prim_count);
        } else {
            tree.nodes[next].below = Below::Nodes(tree.nodes.len() as u32);
            for child in [node.first_index + 1, node.first_index] {
                stack.push((tree.nodes.len(), child));
                tree.push(&bvh, child);
            }
        }
    }
    tree
}

impl Tree {
    fn push(&mut self, bvh: &Bvh2, node: u32) {
        let bounds = &bvh.nodes[node as usize].aabb;
        self.nodes.push(Node {
            bounds: [bounds.min.to_array(), bounds.max.to_array()],
            below: Below::Items(0, 0),
        });
    }
}

impl Tree {
    /// Makes leaves of all nodes with so many items at most: fuller ones than the surface area
    /// heuristic would. Items below a node follow each other.
    pub fn with_leaves_of(mut self, most: u32) -> Self {
        // Children come after their parents; what is below a leaf is never asked for again.
        let mut below = vec![(0u32, 0u32); self.nodes.len()];
        for (number, node) in self.nodes.iter_mut().enumerate().rev() {
            below[number] = match node.below {
                Below::Items(first, count) => (first, count),
                Below::Nodes(child) => {
                    let [a, b] = [below[child as usize], below[child as usize + 1]];
                    (a.0.min(b.0), a.1 + b.1)
                }
            };
            let (first, count) = below[number];
            if count <= most {
                node.below = Below::Items(first, count);
            }
        }
        self
    }
}

/// The smallest box around both.
pub(super) fn union(a: &Box3, b: &Box3) -> Box3 {
    [
        [0, 1, 2].map(|i| a[0][i].min(b[0][i])),
        [0, 1, 2].map(|i| a[1][i].max(b[1][i])),
    ]
}

/// Children of a wide node.
pub(super) const WIDTH: usize = 4;

/// What is below a child of a [`WideNode`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WideChild {
    /// A node.
    Node(u32),
    /// So much as a leaf is to its owner.
    Leaf(u64),
}

/// A node of four children as Embree's BVH4 lays it out, 128 bytes; an empty child's box is inside
/// out.
///
/// ```text
/// byte  0  lo     3 × 4 × f32   axis by axis
///      48  hi     3 × 4 × f32
///      96  child  4 × u64       bit 63 set: a leaf
/// ```
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct WideNode {
    pub lo: [[f32; WIDTH]; 3],
    pub hi: [[f32; WIDTH]; 3],
    child: [u64; WIDTH],
}

const _: () = assert!(size_of::<WideNode>() == 128);

/// Set in a child that is a leaf.
const LEAF: u64 = 1 << 63;

impl WideNode {
    const EMPTY: Self = Self {
        lo: [[f32::INFINITY; WIDTH]; 3],
        hi: [[f32::NEG_INFINITY; WIDTH]; 3],
        child: [LEAF; WIDTH],
    };

    /// One child.
    #[inline(always)]
    pub fn child(&self, k: usize) -> WideChild {
        let child = self.child[k];
        if child & LEAF != 0 {
            WideChild::Leaf(child & !LEAF)
        } else {
            WideChild::Node(child as u32)
        }
    }

    /// A child's box.
    #[inline(always)]
    pub fn bounds(&self, k: usize) -> Box3 {
        [
            [self.lo[0][k], self.lo[1][k], self.lo[2][k]],
            [self.hi[0][k], self.hi[1][k], self.hi[2][k]],
        ]
    }
}

/// Collapses a binary hierarchy into nodes of four children, from the leaves up, so that few places
/// stay empty (paper B, §5.2). `leaf` says what a leaf is to its owner, of 63 bits.
pub(super) fn collapse(tree: &Tree, mut leaf: impl FnMut(&[u32]) -> u64) -> Vec<WideNode> {
    let mut wide = Vec::new();
    if tree.nodes.is_empty() {
        return wide;
    }
    // How many children each binary node has if it becomes a wide one, and which do. Children come
    // after their parents.
    let mut num_children = vec![1usize; tree.nodes.len()];
    let mut is_wide = vec![false; tree.nodes.len()];
    is_wide[0] = true;
    for (number, node) in tree.nodes.iter().enumerate().rev() {
        let Below::Nodes(first) = node.below else {
            continue;
        };
        let (mut more, mut fewer) = (first as usize, first as usize + 1);
        if num_children[fewer] > num_children[more] {
            std::mem::swap(&mut more, &mut fewer);
        }
        let mut sum = num_children[more] + num_children[fewer];
        for child in [more, fewer] {
            if sum > WIDTH {
                is_wide[child] = true;
                sum -= num_children[child] - 1;
            }
        }
        num_children[number] = sum;
    }
    drop(num_children);
    // Depth first. Places, and the binary nodes that wide ones are made of.
    let mut stack = vec![(0, 0u32)];
    wide.push(WideNode::EMPTY);
    while let Some((place, made_of)) = stack.pop() {
        let mut children = Vec::with_capacity(WIDTH);
        let mut open = vec![made_of];
        while let Some(number) = open.pop() {
            match tree.nodes[number as usize].below {
                Below::Nodes(first) if number == made_of || !is_wide[number as usize] => {
                    open.extend([first + 1, first]);
                }
                _ => children.push(number),
            }
        }
        let mut node = WideNode::EMPTY;
        for (k, &child) in children.iter().enumerate() {
            let binary = &tree.nodes[child as usize];
            for axis in 0..3 {
                node.lo[axis][k] = binary.bounds[0][axis];
                node.hi[axis][k] = binary.bounds[1][axis];
            }
            node.child[k] = match binary.below {
                Below::Nodes(_) => {
                    stack.push((wide.len(), child));
                    wide.push(WideNode::EMPTY);
                    wide.len() as u64 - 1
                }
                Below::Items(first, count) => {
                    let items = &tree.items[first as usize..(first + count) as usize];
                    LEAF | leaf(items)
                }
            };
        }
        wide[place] = node;
    }
    wide
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_in_one_leaf_within_all_boxes_above() {
        let boxes: Vec<Box3> = (0..57u32)
            .map(|i| {
                let at = [i % 5, i / 5 % 4, i / 20].map(|c| c as f32);
                [at, at.map(|c| c + 0.7)]
            })
            .collect();
        for most in [1, 4] {
            let tree = build(&boxes).with_leaves_of(most);
            let mut leaves = Vec::new();
            let wide = collapse(&tree, |items| {
                leaves.push(items.to_vec());
                leaves.len() as u64 - 1
            });
            let mut seen = vec![0; boxes.len()];
            let mut stack = vec![(0u32, [[0.0; 3]; 2])];
            while let Some((number, above)) = stack.pop() {
                let node = &wide[number as usize];
                for k in 0..WIDTH {
                    let bounds = node.bounds(k);
                    if bounds[0][0] > bounds[1][0] {
                        continue;
                    }
                    assert!(number == 0 || union(&above, &bounds) == above);
                    match node.child(k) {
                        WideChild::Node(below) => stack.push((below, bounds)),
                        WideChild::Leaf(leaf) => {
                            for &item in &leaves[leaf as usize] {
                                seen[item as usize] += 1;
                                let inner = &boxes[item as usize];
                                assert_eq!(union(&bounds, inner), bounds);
                            }
                        }
                    }
                }
            }
            assert!(seen.iter().all(|&n| n == 1), "{most}: {seen:?}");
            assert!(leaves.iter().all(|l| l.len() <= most as usize));
            assert_eq!(tree.nodes.len(), 2 * boxes.len() - 1);
        }
        assert!(build(&[]).nodes.is_empty());
    }
}

//! From the binary tree to nodes of eight children, bottom up.
//!
//! Source: paper B, §5.2 and §5.5. Variant 1 keeps the largest subtrees of at most eight leaves, each
//! of which becomes a multi-leaf, and forgets what is above. Variant 2 merges upward: two lists of
//! children become one where they have at most eight together; otherwise the longer list is closed,
//! becomes a node and counts as one child from then on, and if that is still too many so does the
//! other.

use crate::bvh::{Below, BinaryNode};
use crate::layout::WIDTH;

/// A node to be: which binary node it stands for, and its children, by binary node too.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WideNode {
    /// The binary node whose box it has.
    pub node: u32,
    /// Its children: leaves, or nodes that are closed.
    pub children: List,
    /// Place of the first child that is no leaf.
    pub first_child: u32,
}

/// Up to eight binary nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct List {
    items: [u32; WIDTH],
    len: u8,
}

impl List {
    fn one(item: u32) -> Self {
        let mut list = Self::default();
        list.items[0] = item;
        list.len = 1;
        list
    }

    fn joined(mut self, other: &Self) -> Self {
        for &item in other.as_slice() {
            self.items[usize::from(self.len)] = item;
            self.len += 1;
        }
        self
    }

    fn len(&self) -> usize {
        usize::from(self.len)
    }

    /// The nodes.
    pub fn as_slice(&self) -> &[u32] {
        &self.items[..self.len()]
    }
}

/// Variant 1: multi-leaves over the largest subtrees of at most eight leaves, left to right.
pub fn multi_leaves(nodes: &[BinaryNode]) -> Vec<WideNode> {
    let mut leaves: Vec<List> = Vec::with_capacity(nodes.len());
    let mut overfull = Vec::with_capacity(nodes.len());
    for (i, node) in (0u32..).zip(nodes) {
        let (list, over) = match node.below {
            Below::Leaf(_) => (List::one(i), false),
            Below::Nodes(a, b) => {
                let (a, b) = (a as usize, b as usize);
                let over = overfull[a] || overfull[b] || leaves[a].len() + leaves[b].len() > WIDTH;
                let list = if over {
                    List::default()
                } else {
                    leaves[a].joined(&leaves[b])
                };
                (list, over)
            }
        };
        leaves.push(list);
        overfull.push(over);
    }
    let mut wide = Vec::new();
    let mut stack = vec![(nodes.len() - 1) as u32];
    while let Some(node) = stack.pop() {
        match nodes[node as usize].below {
            Below::Nodes(a, b) if overfull[node as usize] => stack.extend([b, a]),
            _ => wide.push(WideNode {
                node,
                children: leaves[node as usize],
                first_child: 0,
            }),
        }
    }
    wide
}

/// Variant 2: multi-nodes, the root first, the inner children of a node next to each other and after
/// it.
pub fn multi_nodes(nodes: &[BinaryNode]) -> Vec<WideNode> {
    let mut lists: Vec<List> = Vec::with_capacity(nodes.len());
    for (i, node) in (0u32..).zip(nodes) {
        let list = match node.below {
            Below::Leaf(_) => List::one(i),
            Below::Nodes(a, b) => {
                let (mut left, mut right) = (lists[a as usize], lists[b as usize]);
                if left.len() + right.len() > WIDTH {
                    if left.len() >= right.len() {
                        left = List::one(a);
                    } else {
                        right = List::one(b);
                    }
                }
                if left.len() + right.len() > WIDTH {
                    if left.len() >= right.len() {
                        left = List::one(a);
                    } else {
                        right = List::one(b);
                    }
                }
                left.joined(&right)
            }
        };
        lists.push(list);
    }
    let root = (nodes.len() - 1) as u32;
    let is_leaf = |node: u32| matches!(nodes[node as usize].below, Below::Leaf(_));
    let new = |node: u32| WideNode {
        node,
        children: lists[node as usize],
        first_child: 0,
    };
    let mut wide = vec![new(root)];
    let mut stack = vec![0usize];
    while let Some(place) = stack.pop() {
        let children = wide[place].children;
        let first = wide.len();
        wide[place].first_child = first as u32;
        let inner = children.as_slice().iter().filter(|&&c| !is_leaf(c));
        wide.extend(inner.map(|&c| new(c)));
        stack.extend((first..wide.len()).rev());
    }
    wide
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Box4;
    use proptest::prelude::*;

    /// A tree whose shape follows a list of choices: which two roots join next.
    fn tree(leaves: usize, choices: &[usize]) -> Vec<BinaryNode> {
        let node = |below| BinaryNode {
            bounds: Box4::EMPTY,
            below,
        };
        let mut nodes: Vec<BinaryNode> = (0..leaves as u32).map(|i| node(Below::Leaf(i))).collect();
        let mut roots: Vec<u32> = (0..leaves as u32).collect();
        let mut choices = choices.iter().cycle();
        while roots.len() > 1 {
            let i = choices.next().unwrap_or(&0) % (roots.len() - 1);
            let b = roots.remove(i + 1);
            nodes.push(node(Below::Nodes(roots[i], b)));
            roots[i] = (nodes.len() - 1) as u32;
        }
        nodes
    }

    proptest! {
        #[test]
        fn every_leaf_is_reached_once(
            leaves in 1usize..200,
            choices in prop::collection::vec(0usize..1000, 1..50),
        ) {
            let nodes = tree(leaves, &choices);
            let is_leaf = |n: u32| matches!(nodes[n as usize].below, Below::Leaf(_));

            let mut seen = vec![0; leaves];
            for wide in multi_leaves(&nodes) {
                for &child in wide.children.as_slice() {
                    prop_assert!(is_leaf(child));
                    seen[child as usize] += 1;
                }
            }
            prop_assert!(seen.iter().all(|&n| n == 1));

            let wide = multi_nodes(&nodes);
            let mut seen = vec![0; leaves];
            let mut referenced = vec![0; wide.len()];
            referenced[0] = 1;
            for (place, node) in wide.iter().enumerate() {
                let mut next = node.first_child as usize;
                for &child in node.children.as_slice() {
                    if is_leaf(child) {
                        seen[child as usize] += 1;
                    } else {
                        prop_assert!(next > place);
                        prop_assert_eq!(wide[next].node, child);
                        referenced[next] += 1;
                        next += 1;
                    }
                }
                prop_assert!(node.children.len() > 1 || leaves == 1);
            }
            prop_assert!(seen.iter().all(|&n| n == 1));
            prop_assert!(referenced.iter().all(|&n| n == 1));
        }
    }
}

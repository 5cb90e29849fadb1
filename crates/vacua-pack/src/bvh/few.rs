//! The lower end of the tree: up to [`FEW`] primitives, where every place to split is tried.
//!
//! They are put in order once along each axis; below, lists stay in order as they are divided.

use super::prim::{Frame, Lanes, Prim};
use super::{Below, Builder, LeafMaker, MAX_SAH_DEPTH, tests_after_split};

/// Up to so many primitives every place to split is tried.
pub const FEW: usize = 32;

/// The primitives, which stay where they are.
struct Group<'a> {
    prims: &'a [Prim],
    frame: &'a Frame,
}

/// Places of the primitives in the order of their centres along each axis.
type Orders = [[u8; FEW]; 3];

impl<M: LeafMaker> Builder<'_, M> {
    /// Builds the tree over at least one primitive and at most [`FEW`]; gives its root.
    pub(super) fn build_few(&mut self, prims: &[Prim], frame: &Frame, depth: usize) -> u32 {
        let n = prims.len().min(FEW);
        for p in prims {
            self.maker.prefetch(p.number());
        }
        if self.is_leaf_anyway(n)
            && let Some(node) = self.leaf(prims)
        {
            return node;
        }
        let mut orders: Orders = [[0; FEW]; 3];
        for (axis, order) in orders.iter_mut().enumerate() {
            let mut keys = [0u32; FEW];
            for (i, (key, p)) in (0u32..).zip(keys.iter_mut().zip(prims)) {
                *key = (i32::from(p.center(axis)) - i32::from(i16::MIN)) as u32 * 256 + i;
            }
            keys[..n].sort_unstable();
            for (place, key) in order.iter_mut().zip(keys) {
                *place = key as u8;
            }
        }
        self.few(&Group { prims, frame }, &mut orders, 0..n, depth)
    }

    /// The tree over those of the primitives that are in a range of the orders.
    fn few(
        &mut self,
        all: &Group,
        orders: &mut Orders,
        range: std::ops::Range<usize>,
        depth: usize,
    ) -> u32 {
        let n = range.len();
        let mut split = None;
        let mut is_leaf = self.is_leaf_anyway(n);
        if !is_leaf {
            let found = all.best_split(orders, &range, depth);
            is_leaf = self.wants_leaf(found.0, n);
            split = Some(found);
        }
        if is_leaf && n <= M::MAX_PRIMS {
            let mut prims = [Prim::NONE; FEW];
            for (to, &place) in prims.iter_mut().zip(&orders[0][range.clone()]) {
                *to = all.prims[usize::from(place)];
            }
            if let Some(node) = self.leaf(&prims[..n]) {
                return node;
            }
        }
        let (_, middle, axis) = split.unwrap_or_else(|| all.best_split(orders, &range, depth));
        let middle = range.start + middle;
        let mut is_left = [false; FEW];
        for &place in &orders[axis][range.start..middle] {
            is_left[usize::from(place)] = true;
        }
        for other in (0..3).filter(|&other| other != axis) {
            let order = &mut orders[other][range.clone()];
            let mut right = [0u8; FEW];
            let (mut num_left, mut num_right) = (0, 0);
            for k in 0..n {
                let place = order[k];
                let left = is_left[usize::from(place) % FEW];
                order[num_left] = place;
                right[num_right] = place;
                num_left += usize::from(left);
                num_right += usize::from(!left);
            }
            order[num_left..].copy_from_slice(&right[..num_right]);
        }
        let left = self.few(all, orders, range.start..middle, depth + 1);
        let right = self.few(all, orders, middle..range.end, depth + 1);
        self.push(Below::Nodes(left, right))
    }
}

impl Group<'_> {
    /// The tests left after the best split, how many go to the left, and the axis. At least two.
    fn best_split(
        &self,
        orders: &Orders,
        range: &std::ops::Range<usize>,
        depth: usize,
    ) -> (f32, usize, usize) {
        let n = range.len();
        let halves = (f32::INFINITY, n / 2, 0);
        if depth >= MAX_SAH_DEPTH {
            return halves;
        }
        let mut best = halves;
        let mut whole = Lanes::EMPTY;
        for (axis, order) in orders.iter().enumerate() {
            let order = &order[range.clone()];
            let mut right = [0.0f32; FEW];
            let mut b = Lanes::EMPTY;
            for k in (1..n).rev() {
                b = b.union(&self.prims[usize::from(order[k])].bounds());
                right[k] = self.frame.half_area(&b) * (n - k) as f32;
            }
            whole = b.union(&self.prims[usize::from(order[0])].bounds());
            let mut b = Lanes::EMPTY;
            for k in 1..n {
                b = b.union(&self.prims[usize::from(order[k - 1])].bounds());
                let left = self.frame.half_area(&b) * k as f32;
                if left >= best.0 {
                    break;
                }
                if left + right[k] < best.0 {
                    best = (left + right[k], k, axis);
                }
            }
        }
        let tests = tests_after_split(best.0, self.frame.half_area(&whole));
        (tests, best.1, best.2)
    }
}

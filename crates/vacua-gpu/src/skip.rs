//! Macrocells and the distance map on the device (paper A §4.1.1 and §4.2.1).
//!
//! The map holds a byte a macrocell: 0 if it is active, else the Chebyshev distance to the nearest
//! active one, up to a reach; beside active ones, which boxes of two macrocells a side hold any. Rays of a
//! subgroup look at one box of macrocells for all of them, or step over boxes of known distance each; with
//! a reach of 1 that is a plain walk from macrocell to macrocell.

use std::sync::Arc;

use vacua_skip::{Lattice, Macrocells};

use crate::error::GpuError;
use crate::send::sent;
use crate::shared::{BRICK, GROUP};
use crate::vulkan::{Buffer, Commands, Device, Layout, Place};

/// Ranges of macrocells of one size.
pub(crate) struct DeviceMacrocells {
    pub counts: [u32; 3],
    pub ranges: Buffer,
    /// Two maps, as passes read one and write the other.
    pub maps: [Buffer; 2],
    /// Whether the ranges have been computed.
    pub is_ready: bool,
    /// Bricks of lattice points in Morton order, by their numbers, and how many there are; made when the
    /// boundary is first asked for.
    bricks: Option<(Buffer, u32)>,
}

impl DeviceMacrocells {
    pub fn new(device: &Arc<Device>, lattice: &Lattice) -> Result<Self, GpuError> {
        let num = lattice.len() as u64;
        let map = || {
            Buffer::new(
                device,
                "the distance map",
                num.next_multiple_of(4),
                Place::Device,
            )
        };
        Ok(Self {
            counts: lattice.counts().map(|n| n as u32),
            ranges: Buffer::new(device, "the ranges of macrocells", 8 * num, Place::Device)?,
            maps: [map()?, map()?],
            is_ready: false,
            bricks: None,
        })
    }

    /// Sends ranges that the host has.
    pub fn send_ranges(
        &mut self,
        device: &Arc<Device>,
        commands: &mut Commands,
        layout: &Layout,
        macrocells: &Macrocells,
    ) -> Result<(), GpuError> {
        let none = (f32::INFINITY, f32::NEG_INFINITY);
        let ranges: Vec<[f32; 2]> = (0..macrocells.lattice().len())
            .map(|i| macrocells.range(i).unwrap_or(none).into())
            .collect();
        let bytes: &[u8] = bytemuck::cast_slice(&ranges);
        self.ranges = sent(device, commands, layout, "the ranges of macrocells", bytes)?;
        self.is_ready = true;
        Ok(())
    }

    /// Puts bricks of lattice points in order, unless that was done; there are none where there are more
    /// macrocells than shaders can number.
    pub fn order_bricks(
        &mut self,
        device: &Arc<Device>,
        commands: &mut Commands,
        layout: &Layout,
    ) -> Result<(), GpuError> {
        let is_too_large =
            self.len() > MOST_BOUNDED || self.counts.iter().any(|&n| n > MOST_PLANES);
        if self.bricks.is_some() || is_too_large {
            return Ok(());
        }
        let order = morton_order([0, 1, 2].map(|a| (self.counts[a] + 1).div_ceil(BRICK[a])));
        let bytes: &[u8] = bytemuck::cast_slice(&order);
        let buffer = sent(device, commands, layout, "the order of bricks", bytes)?;
        self.bricks = Some((buffer, order.len() as u32));
        Ok(())
    }

    /// Where the order of bricks lies, and how many there are, if they have one.
    pub fn bricks(&self) -> Option<(u64, u32)> {
        let (buffer, num) = self.bricks.as_ref()?;
        Some((buffer.address(), *num))
    }

    /// How many there are.
    pub fn len(&self) -> u64 {
        self.counts.iter().map(|&n| u64::from(n)).product()
    }

    /// Workgroups for one macrocell each.
    pub fn groups(&self) -> [u32; 3] {
        spread(self.len())
    }

    /// Workgroups for four macrocells an invocation.
    pub fn word_groups(&self) -> [u32; 3] {
        spread(self.len().div_ceil(4 * u64::from(GROUP)))
    }
}

/// Most macrocells that shaders of the boundary can number, and most of their planes along an axis that its
/// hierarchy can.
const MOST_BOUNDED: u64 = u32::MAX as u64;
const MOST_PLANES: u32 = u16::MAX as u32;

/// Numbers of bricks, x first, in Morton order of their places.
fn morton_order([nx, ny, nz]: [u32; 3]) -> Vec<u32> {
    let spread = |n: u32| {
        (0..21).fold(0u64, |code, bit| {
            code | u64::from(n >> bit & 1) << (3 * bit)
        })
    };
    let place = |i: u32| [i % nx, i / nx % ny, i / nx / ny];
    let code = |i: &u32| {
        let [x, y, z] = place(*i).map(spread);
        x | y << 1 | z << 2
    };
    let mut order: Vec<u32> = (0..nx * ny * nz).collect();
    order.sort_by_cached_key(code);
    order
}

/// Spreads workgroups over two axes; shaders number them the same way.
pub(crate) fn spread(groups: u64) -> [u32; 3] {
    const MOST: u64 = 65535;
    [groups.min(MOST) as u32, groups.div_ceil(MOST) as u32, 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bricks_follow_each_other_in_morton_order() {
        assert_eq!(morton_order([2, 2, 2]), [0, 1, 2, 3, 4, 5, 6, 7]);
        // Of a row of three, the first two and all beside them come before the third.
        assert_eq!(morton_order([3, 2, 1]), [0, 1, 3, 4, 2, 5]);
        let mut order = morton_order([7, 1, 5]);
        order.sort_unstable();
        assert_eq!(order, (0..35).collect::<Vec<u32>>());
    }
}

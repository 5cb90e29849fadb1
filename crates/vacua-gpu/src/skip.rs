//! Macrocells and the distance map on the device (paper A §4.1.1 and §4.2.1).
//!
//! The map holds a byte a macrocell: 0 if it is active, else the Chebyshev distance to the nearest
//! active one, up to a reach; beside active ones, which boxes of two macrocells a side hold any. Rays of a
//! subgroup look at one box of macrocells for all of them, or step over boxes of known distance each; with
//! a reach of 1 that is a plain walk from macrocell to macrocell.

use std::sync::Arc;

use vacua_skip::{Lattice, Macrocells};

use crate::error::GpuError;
use crate::shared::{GROUP, POINTS_A_GROUP};
use crate::vulkan::{Buffer, Commands, Device, Layout, Place};

/// Ranges of macrocells of one size.
pub(crate) struct DeviceMacrocells {
    pub counts: [u32; 3],
    pub ranges: Buffer,
    /// Two maps, as passes read one and write the other.
    pub maps: [Buffer; 2],
    /// Whether the ranges have been computed.
    pub is_ready: bool,
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
        let size = bytes.len() as u64;
        let mut staging = Buffer::new(device, "sending ranges", size, Place::Upload)?;
        staging.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
        commands.run(layout, |recorder| {
            recorder.copy(&staging, &self.ranges, 0, size);
            recorder.barrier();
            Ok(())
        })?;
        self.is_ready = true;
        Ok(())
    }

    /// Points of their lattice; `None` if there are more than shaders can number.
    pub fn points(&self) -> Option<u32> {
        let points = self
            .counts
            .iter()
            .map(|&n| u64::from(n) + 1)
            .product::<u64>();
        // The last group of points may reach beyond them.
        u32::try_from(points + u64::from(POINTS_A_GROUP)).ok()?;
        u32::try_from(points).ok()
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

/// Spreads workgroups over two axes; shaders number them the same way.
pub(crate) fn spread(groups: u64) -> [u32; 3] {
    const MOST: u64 = 65535;
    [groups.min(MOST) as u32, groups.div_ceil(MOST) as u32, 1]
}

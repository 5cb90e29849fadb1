//! The transfer table as shaders read it: four halves an entry, extinction as a part of the largest.
//!
//! Halves keep colour and extinction to 0.05 %, a tenth of a step of an 8-bit picture, and are half
//! the bytes of every lookup. Which bins are active is asked of the rounded entries: what rounds to
//! nothing is classified as nothing.

use half::f16;
use vacua_volume::{TRANSFER_BINS, TransferTable, ValueScale};

/// A transfer table ready to be sent.
pub(crate) struct DeviceTable {
    /// Red, green, blue, extinction.
    pub entries: Vec<[f16; 4]>,
    /// For each bin, the first one at or after it with any extinction.
    pub next_active: Vec<u32>,
    /// Value at coordinate 0, bins per key, largest extinction.
    pub scale: [f32; 3],
    pub is_log: bool,
}

impl DeviceTable {
    pub fn new(table: &TransferTable) -> Self {
        let largest = table
            .entries()
            .iter()
            .map(|entry| entry[3])
            .fold(0.0, f32::max);
        let part = if largest > 0.0 { largest.recip() } else { 0.0 };
        let halves =
            |&[r, g, b, extinction]: &[f32; 4]| [r, g, b, extinction * part].map(f16::from_f32);
        let entries: Vec<[f16; 4]> = table.entries().iter().map(halves).collect();
        let mut next_active = vec![TRANSFER_BINS as u32; TRANSFER_BINS + 1];
        for bin in (0..TRANSFER_BINS).rev() {
            let is_active = [bin, bin + 1].iter().any(|&i| entries[i][3] > f16::ZERO);
            next_active[bin] = if is_active {
                bin as u32
            } else {
                next_active[bin + 1]
            };
        }
        Self {
            entries,
            next_active,
            scale: [table.lo(), table.bins_per_key(), largest],
            is_log: table.scale() == ValueScale::Log,
        }
    }

    /// The entries as they are sent, one of padding, and for each bin both ends of its extinction,
    /// which is all that most samples ask for.
    pub fn entry_bytes(&self) -> Vec<u8> {
        let padding = [[f16::ZERO; 4]];
        let entries = self.entries.iter().chain(&padding).flatten();
        let ends = self
            .entries
            .windows(2)
            .flat_map(|pair| [&pair[0][3], &pair[1][3]]);
        let halves = entries.chain(ends);
        halves.flat_map(|half| half.to_le_bytes()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vacua_volume::{ColorPoint, OpacityPoint, TransferFunction, ValueMap, ValueRange};

    #[test]
    fn rounding_keeps_what_is_seen() {
        let color = |value, srgb| ColorPoint { value, srgb };
        let opacities = [(0.0, 0.0), (0.3, 0.0), (0.6, 0.9), (1.0, 1e-4)];
        let opacities = opacities.map(|(value, opacity)| OpacityPoint { value, opacity });
        let function = TransferFunction::new(
            vec![color(0.0, [0.1, 0.5, 0.9]), color(1.0, [1.0, 0.0, 0.3])],
            opacities.to_vec(),
            1e-9,
            ValueScale::Linear,
        );
        let range = ValueRange { lo: 0.0, hi: 1.0 };
        let table = TransferTable::new(&function.expect("sorted"), range, ValueMap::IDENTITY);
        let device = DeviceTable::new(&table);
        let bytes = device.entry_bytes();
        let ends = &bytes[8 * (TRANSFER_BINS + 2)..];
        assert_eq!(ends.len(), 4 * TRANSFER_BINS);
        for (bin, ends) in ends.chunks(4).enumerate() {
            let found = [0, 2].map(|i| f16::from_le_bytes([ends[i], ends[i + 1]]));
            assert_eq!(found, [device.entries[bin][3], device.entries[bin + 1][3]]);
        }
        assert!(
            device.scale[2] > 1e9,
            "extinction per metre of nanometre data"
        );
        for i in 0..=TRANSFER_BINS {
            let expected = table.entries()[i][3];
            let found = device.entries[i][3].to_f32() * device.scale[2];
            assert!((found - expected).abs() <= 6e-4 * expected, "{i}");
        }
        assert_eq!(device.next_active, table.next_active());
    }
}

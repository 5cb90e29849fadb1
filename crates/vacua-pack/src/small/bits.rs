//! Numbers of any width, one after the other, lowest bits first.

/// Bytes after the last number, so that eight bytes can be read at any number.
pub const PADDING: usize = 16;
/// The widest number that one read of eight bytes gives wherever it starts.
const ONE_READ: u32 = 57;

/// Bits that a number takes.
#[inline(always)]
pub fn width_of(number: u64) -> u32 {
    u64::BITS - number.leading_zeros()
}

/// Writes numbers; what is pending is flushed at the end.
pub struct BitWriter<'a> {
    out: &'a mut Vec<u8>,
    pending: u128,
    num_pending: u32,
}

impl<'a> BitWriter<'a> {
    /// Appends to some bytes.
    pub fn new(out: &'a mut Vec<u8>) -> Self {
        Self {
            out,
            pending: 0,
            num_pending: 0,
        }
    }

    /// Appends a number of at most 64 bits, which must fit.
    pub fn push(&mut self, number: u64, width: u32) {
        self.pending |= u128::from(number) << self.num_pending;
        self.num_pending += width;
        while self.num_pending >= 8 {
            self.out.push(self.pending as u8);
            self.pending >>= 8;
            self.num_pending -= 8;
        }
    }

    /// Fills the last byte with zeros.
    pub fn finish(self) {
        if self.num_pending > 0 {
            self.out.push(self.pending as u8);
        }
    }
}

/// The lowest `width` bits.
#[inline(always)]
pub fn mask(width: u32) -> u64 {
    if width >= u64::BITS {
        u64::MAX
    } else {
        (1 << width) - 1
    }
}

/// Eight bytes from a bit on, of which 57 bits at least are whole; 0 past the end.
#[inline(always)]
fn eight_bytes(bytes: &[u8], bit: u64) -> u64 {
    let byte = usize::try_from(bit / 8).unwrap_or(usize::MAX);
    match bytes.get(byte..).and_then(|from| from.first_chunk()) {
        Some(&eight) => u64::from_le_bytes(eight) >> (bit % 8),
        None => 0,
    }
}

/// A number of at most 57 bits from a bit on; 0 past the end.
#[inline(always)]
pub fn read(bytes: &[u8], bit: u64, width: u32) -> u64 {
    eight_bytes(bytes, bit) & mask(width)
}

/// A number of at most 64 bits from a bit on; 0 past the end.
#[inline(always)]
pub fn read_wide(bytes: &[u8], bit: u64, width: u32) -> u64 {
    if width <= ONE_READ {
        return read(bytes, bit, width);
    }
    let low = read(bytes, bit, 32);
    low | read(bytes, bit.saturating_add(32), width - 32) << 32
}

/// Reads numbers one after the other.
#[derive(Clone, Copy)]
pub struct BitReader<'a> {
    bytes: &'a [u8],
    bit: u64,
}

impl<'a> BitReader<'a> {
    /// From the first bit of some bytes on.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, bit: 0 }
    }

    /// The next number of at most 57 bits.
    #[inline(always)]
    pub fn next(&mut self, width: u32) -> u64 {
        let number = read(self.bytes, self.bit, width);
        self.bit += u64::from(width);
        number
    }

    /// The next `N` numbers of at most 9 bits each.
    #[inline(always)]
    pub fn next_few<const N: usize>(&mut self, width: u32) -> [u8; N] {
        const { assert!(N <= 8) };
        let mut numbers = [0; N];
        for half in numbers.chunks_mut(6) {
            let mut word = eight_bytes(self.bytes, self.bit);
            for number in half.iter_mut() {
                *number = (word & mask(width)) as u8;
                word >>= width;
            }
            self.bit += u64::from(width) * half.len() as u64;
        }
        numbers
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_come_back(raw in prop::collection::vec((any::<u64>(), 0u32..=64), 0..80)) {
            let numbers: Vec<(u64, u32)> = raw.iter().map(|&(n, w)| (n & mask(w), w)).collect();
            let mut bytes = Vec::new();
            let mut writer = BitWriter::new(&mut bytes);
            numbers.iter().for_each(|&(n, w)| writer.push(n, w));
            writer.finish();
            bytes.extend([0xFF; PADDING]);
            let mut bit = 0;
            for (n, w) in numbers {
                prop_assert_eq!(read_wide(&bytes, bit, w), n);
                prop_assert!(width_of(n) <= w);
                bit += u64::from(w);
            }
            prop_assert_eq!(read_wide(&bytes, u64::MAX, 64), 0);
        }

        #[test]
        fn few_at_a_time(width in 1u32..=8, raw in prop::collection::vec(any::<u8>(), 13)) {
            let numbers: Vec<u8> = raw.iter().map(|&n| n & mask(width) as u8).collect();
            let mut bytes = Vec::new();
            let mut writer = BitWriter::new(&mut bytes);
            numbers.iter().for_each(|&n| writer.push(u64::from(n), width));
            writer.finish();
            bytes.extend([0xFF; PADDING]);
            let mut reader = BitReader::new(&bytes);
            prop_assert_eq!(&reader.next_few::<5>(width)[..], &numbers[..5]);
            prop_assert_eq!(&reader.next_few::<8>(width)[..], &numbers[5..]);
        }
    }
}

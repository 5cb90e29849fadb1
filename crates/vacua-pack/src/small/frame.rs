//! Numbers of 64 neighbours relative to a frame they share: exact, and readable one at a time.
//!
//! The bits of every number, turned so that they order as the numbers do, are unsigned integers
//! ([`key_of`]). Of 64 numbers the least is the base; what the others add to it is shifted right by
//! the zeros that all end in and stored in as many bits as the largest needs. Neighbours on a mesh
//! share sign, exponent and leading digits: 19 to 22 bits a coordinate are left of 32 where positions
//! are jittered, 3 where they lie on a lattice.
//!
//! ```text
//! a block of positions, 24 bytes:
//! byte  0  base     3 × u32   least key along each axis
//!      12  offset       u32   where its records start, in bytes from the sub-mesh's first
//!      16  width     3 × u8   bits along each axis, 0 to 32
//!      19  shift     3 × u8   zeros left out
//!      22  reserved  2 × u8   zero
//! a record: x, y, z in width[0] + width[1] + width[2] bits; records follow each other
//!
//! a block of values, 16 bytes:
//! byte  0  base         u64   least key
//!       8  offset       u48   where its numbers start, in bytes from the field's first
//!      14  width        u8    bits, 0 to 64
//!      15  shift        u8    zeros left out
//! ```

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use vacua_volume::{ArrayError, DataArray, Scalar, ScalarType, dispatch_scalar};

use super::bits::{BitWriter, PADDING, mask, read, read_wide, width_of};
use crate::section::Flat;

/// Numbers that share a frame.
pub const BLOCK: usize = 64;
/// Largest offset of a block of values.
const MAX_OFFSET: u64 = (1 << 48) - 1;

/// The frame of some keys: base, width and shift.
fn frame_of(keys: impl Iterator<Item = u64> + Clone) -> (u64, u32, u32) {
    let base = keys.clone().min().unwrap_or(0);
    let all = keys.fold(0, |all, key| all | (key - base));
    // Nothing but zeros: no bits at all.
    let shift = if all == 0 { 0 } else { all.trailing_zeros() };
    (base, width_of(all >> shift), shift)
}

/// Positions of 64 vertices of a sub-mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PositionBlock {
    base: [u32; 3],
    offset: u32,
    width: [u8; 3],
    shift: [u8; 3],
    reserved: [u8; 2],
}

const _: () = {
    assert!(size_of::<PositionBlock>() == 24);
    assert!(std::mem::offset_of!(PositionBlock, offset) == 12);
    assert!(std::mem::offset_of!(PositionBlock, width) == 16);
    assert!(std::mem::offset_of!(PositionBlock, shift) == 19);
    assert!(size_of::<ValueBlock>() == 16);
};

/// An `f32` as an integer that orders as it does.
#[inline(always)]
fn key_of_f32(value: f32) -> u32 {
    let bits = value.to_bits();
    bits ^ ((bits as i32 >> 31) as u32 | 1 << 31)
}

/// The `f32` of a key.
#[inline(always)]
fn f32_of_key(key: u32) -> f32 {
    f32::from_bits(key ^ ((!key as i32 >> 31) as u32 | 1 << 31))
}

/// Packs positions of a sub-mesh.
pub fn pack_positions(positions: &[[f32; 3]]) -> (Vec<PositionBlock>, Vec<u8>) {
    let mut blocks = Vec::with_capacity(positions.len().div_ceil(BLOCK));
    let mut bits = Vec::with_capacity(positions.len() * 9);
    for some in positions.chunks(BLOCK) {
        let mut block = PositionBlock {
            offset: bits.len() as u32,
            ..Zeroable::zeroed()
        };
        for axis in 0..3 {
            let keys = some.iter().map(|p| u64::from(key_of_f32(p[axis])));
            let (base, width, shift) = frame_of(keys);
            block.base[axis] = base as u32;
            block.width[axis] = width as u8;
            block.shift[axis] = shift as u8;
        }
        let mut writer = BitWriter::new(&mut bits);
        for p in some {
            for axis in 0..3 {
                let delta = key_of_f32(p[axis]) - block.base[axis];
                let width = u32::from(block.width[axis]);
                writer.push(u64::from(delta >> block.shift[axis]), width);
            }
        }
        writer.finish();
        blocks.push(block);
    }
    (blocks, bits)
}

impl PositionBlock {
    /// One of its positions; `bits` start at the sub-mesh's first.
    #[inline(always)]
    pub fn read(&self, bits: &[u8], place: usize) -> [f32; 3] {
        // More than 32 bits no honest block has.
        let width = self.width.map(|w| u32::from(w).min(32));
        let record = u64::from(width[0] + width[1] + width[2]);
        let mut bit = u64::from(self.offset) * 8 + (place % BLOCK) as u64 * record;
        let mut position = [0.0; 3];
        for axis in 0..3 {
            let delta = read(bits, bit, width[axis]) as u32;
            bit += u64::from(width[axis]);
            let delta = delta.wrapping_shl(u32::from(self.shift[axis]));
            position[axis] = f32_of_key(self.base[axis].wrapping_add(delta));
        }
        position
    }
}

/// Frame of 64 values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct ValueBlock {
    base: u64,
    place: u64,
}

impl ValueBlock {
    /// The same after so many bytes more.
    pub(crate) fn moved(self, bytes: u64) -> Self {
        Self {
            place: self.place + (bytes & MAX_OFFSET),
            ..self
        }
    }
}

/// The key of a number by its bits: an unsigned integer that orders as the numbers of its type do.
#[inline(always)]
fn key_of(scalar_type: ScalarType, bits: u64) -> u64 {
    let sign = 1u64 << (8 * scalar_type.size_bytes() - 1);
    match scalar_type {
        ScalarType::U8 | ScalarType::U16 | ScalarType::U32 | ScalarType::U64 => bits,
        ScalarType::I8 | ScalarType::I16 | ScalarType::I32 | ScalarType::I64 => bits ^ sign,
        ScalarType::F32 | ScalarType::F64 if bits & sign != 0 => bits ^ (sign | (sign - 1)),
        ScalarType::F32 | ScalarType::F64 => bits ^ sign,
    }
}

/// The bits of a key; what [`key_of`] turned.
#[inline(always)]
fn bits_of(scalar_type: ScalarType, key: u64) -> u64 {
    let sign = 1u64 << (8 * scalar_type.size_bytes() - 1);
    match scalar_type {
        ScalarType::U8 | ScalarType::U16 | ScalarType::U32 | ScalarType::U64 => key,
        ScalarType::I8 | ScalarType::I16 | ScalarType::I32 | ScalarType::I64 => key ^ sign,
        ScalarType::F32 | ScalarType::F64 if key & sign == 0 => key ^ (sign | (sign - 1)),
        ScalarType::F32 | ScalarType::F64 => key ^ sign,
    }
}

#[inline(always)]
fn raw_bits<T: Scalar>(value: T) -> u64 {
    let mut eight = [0; 8];
    eight[..size_of::<T>()].copy_from_slice(bytemuck::bytes_of(&value));
    u64::from_le_bytes(eight)
}

/// Values of a field in frames, read one at a time. Clones share the bytes.
#[derive(Clone)]
pub struct FramedValues {
    /// Tells values at decoded clusters of one field from those of another.
    pub(crate) id: u64,
    pub(crate) scalar_type: ScalarType,
    pub(crate) blocks: Flat<ValueBlock>,
    pub(crate) bits: Flat<u8>,
}

impl FramedValues {
    /// Packs values, runs of so many each; every run starts a block.
    pub(crate) fn pack(values: &DataArray, runs: impl Iterator<Item = usize>) -> Self {
        let mut pieces = Vec::new();
        let mut start = 0;
        for run in runs {
            let end = (start + run).min(values.tuples());
            while start < end {
                let next = (start + BLOCK).min(end);
                pieces.push(start..next);
                start = next;
            }
        }
        let scalar_type = values.scalar_type();
        let packed: Vec<(Vec<ValueBlock>, Vec<u8>)> = pieces
            .par_chunks(1 << 10)
            .map(|pieces| {
                dispatch_scalar!(scalar_type, T => {
                    let values: &[T] = bytemuck::cast_slice(values.bytes());
                    pack_blocks(pieces.iter().map(|piece| &values[piece.clone()]))
                })
            })
            .collect();
        let mut blocks = Vec::with_capacity(pieces.len());
        let mut bits = Vec::new();
        for (some, bytes) in packed {
            // Bytes of fields are far below 2^48.
            let before = bits.len() as u64 & MAX_OFFSET;
            blocks.extend(some.into_iter().map(|block| block.moved(before)));
            bits.extend(bytes);
        }
        bits.extend([0; PADDING]);
        Self::new(scalar_type, Flat::from_vec(blocks), Flat::from_vec(bits))
    }

    /// Joins the arrays.
    pub(crate) fn new(scalar_type: ScalarType, blocks: Flat<ValueBlock>, bits: Flat<u8>) -> Self {
        Self {
            id: super::next_id(),
            scalar_type,
            blocks,
            bits,
        }
    }

    /// An empty array of the same type.
    pub(crate) fn no_values(&self) -> Result<DataArray, ArrayError> {
        empty(self.scalar_type)
    }

    /// Type of a value.
    pub fn scalar_type(&self) -> ScalarType {
        self.scalar_type
    }

    /// Number of blocks.
    pub(crate) fn num_blocks(&self) -> usize {
        self.blocks.as_slice().len()
    }

    /// Length in bytes.
    pub fn num_bytes(&self) -> usize {
        self.blocks.num_bytes() + self.bits.num_bytes()
    }

    /// A value by block and place in it, as the type that it has; `None` if there is no such block.
    #[inline(always)]
    pub fn get<T: Scalar>(&self, block: u64, place: usize) -> Option<T> {
        let key = self.key(block, place)?;
        let eight = bits_of(T::TYPE, key).to_le_bytes();
        Some(bytemuck::pod_read_unaligned(&eight[..size_of::<T>()]))
    }

    /// As [`Self::get`], in `f64`.
    #[inline]
    pub fn get_f64(&self, block: u64, place: usize) -> Option<f64> {
        dispatch_scalar!(self.scalar_type, T => self.get::<T>(block, place).map(Scalar::to_f64))
    }

    #[inline(always)]
    fn key(&self, block: u64, place: usize) -> Option<u64> {
        let block = self.blocks.as_slice().get(usize::try_from(block).ok()?)?;
        let width = ((block.place >> 48) as u32 & 0xFF).min(u64::BITS);
        let shift = (block.place >> 56) as u32;
        let first = (block.place & MAX_OFFSET) * 8;
        let bit = first + (place % BLOCK) as u64 * u64::from(width);
        let delta = read_wide(self.bits.as_slice(), bit, width).wrapping_shl(shift);
        Some(block.base.wrapping_add(delta & mask(u64::BITS)))
    }
}

/// An array of no values.
pub(crate) fn empty(scalar_type: ScalarType) -> Result<DataArray, ArrayError> {
    dispatch_scalar!(scalar_type, T => DataArray::from_vec(Vec::<T>::new(), 1))
}

/// Frames of pieces of at most [`BLOCK`] values, and the bits within them.
pub(crate) fn pack_blocks<'a, T: Scalar>(
    pieces: impl Iterator<Item = &'a [T]>,
) -> (Vec<ValueBlock>, Vec<u8>) {
    let mut blocks = Vec::new();
    let mut bits = Vec::new();
    for piece in pieces {
        let keys = piece.iter().map(|&v| key_of(T::TYPE, raw_bits(v)));
        let (base, width, shift) = frame_of(keys.clone());
        blocks.push(ValueBlock {
            base,
            place: bits.len() as u64 | u64::from(width) << 48 | u64::from(shift) << 56,
        });
        let mut writer = BitWriter::new(&mut bits);
        keys.for_each(|key| writer.push((key - base) >> shift, width));
        writer.finish();
    }
    (blocks, bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_f32() -> impl Strategy<Value = f32> {
        prop_oneof![
            any::<u32>().prop_map(f32::from_bits),
            -1.0f32..1.0,
            99.0f32..101.0,
            (0u8..100).prop_map(f32::from),
            Just(0.0),
            Just(-0.0),
        ]
    }

    proptest! {
        #[test]
        fn positions_come_back(all in prop::collection::vec(prop::array::uniform3(any_f32()), 0..200)) {
            let (blocks, mut bits) = pack_positions(&all);
            bits.extend([0xFF; PADDING]);
            for (i, p) in all.iter().enumerate() {
                let back = blocks[i / BLOCK].read(&bits, i);
                prop_assert_eq!(back.map(f32::to_bits), p.map(f32::to_bits));
            }
        }

        #[test]
        fn values_come_back(all in prop::collection::vec(any::<u64>(), 1..300), cut in 0usize..300) {
            for scalar_type in ScalarType::ALL {
                dispatch_scalar!(scalar_type, T => {
                    let typed: Vec<T> = all.iter().map(|v| {
                        bytemuck::pod_read_unaligned(&v.to_le_bytes()[..size_of::<T>()])
                    }).collect();
                    let array = DataArray::from_vec(typed.clone(), 1).expect("column");
                    let cut = cut.min(all.len());
                    let framed = FramedValues::pack(&array, [cut, all.len() - cut].into_iter());
                    let second = cut.div_ceil(BLOCK) as u64;
                    for (i, v) in typed.iter().enumerate() {
                        let (block, place) = if i < cut {
                            ((i / BLOCK) as u64, i)
                        } else {
                            (second + ((i - cut) / BLOCK) as u64, i - cut)
                        };
                        let back = framed.get::<T>(block, place).expect("there");
                        prop_assert_eq!(bytemuck::bytes_of(&back), bytemuck::bytes_of(v));
                    }
                    prop_assert!(framed.get::<T>(u64::MAX, 0).is_none());
                });
            }
        }
    }

    #[test]
    fn lattices_and_constants_take_little() {
        let lattice: Vec<[f32; 3]> = (0..64)
            .map(|i| {
                [
                    (i % 4) as f32 + 64.0,
                    (i / 4 % 4) as f32 + 64.0,
                    (i / 16) as f32 + 64.0,
                ]
            })
            .collect();
        let (blocks, bits) = pack_positions(&lattice);
        assert_eq!((blocks.len(), bits.len()), (1, 64 * 6 / 8));
        let constant = DataArray::from_vec(vec![0.1f64; 640], 1).expect("column");
        let framed = FramedValues::pack(&constant, std::iter::once(640));
        assert_eq!(framed.bits.num_bytes(), PADDING);
    }
}

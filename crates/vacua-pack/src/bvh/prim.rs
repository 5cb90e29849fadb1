//! What the builder orders: boxes of sixteen bits a side within a frame, sixteen bytes each with the
//! number of what they are around.
//!
//! They decide on the shape of the tree alone; the boxes of its nodes come from those of its leaves,
//! exactly. Upper corners are stored inverted, so that one minimum of eight lanes joins two boxes.

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

    /// The box between two corners.
    pub fn new(lo: [f32; 3], hi: [f32; 3]) -> Self {
        Self {
            lo: [lo[0], lo[1], lo[2], 0.0],
            hi: [hi[0], hi[1], hi[2], 0.0],
        }
    }

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

    /// Lower corner.
    pub fn lo3(&self) -> [f32; 3] {
        [self.lo[0], self.lo[1], self.lo[2]]
    }

    /// Upper corner.
    pub fn hi3(&self) -> [f32; 3] {
        [self.hi[0], self.hi[1], self.hi[2]]
    }
}

/// Steps of a frame along an axis; one less than sixteen bits have, for rounding.
const STEPS: f32 = 65534.0;
/// Where the first step is.
const FIRST: f32 = i16::MIN as f32;
/// Adding this to a number of fewer than 22 bits leaves the nearest whole number in the lowest bits.
const ROUND: f32 = 12_582_912.0;

/// The box that sixteen bits divide.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Half of the lower corner: differences of halves are finite.
    half_lo: [f32; 4],
    /// Steps per half unit of length.
    scale: [f32; 4],
    /// Length of a step along each axis, in that of the longest.
    step: [f32; 3],
}

impl Frame {
    /// The frame of a box, which must be finite.
    pub fn new(bounds: &Box4) -> Self {
        let mut frame = Self {
            half_lo: [0.0; 4],
            scale: [0.0; 4],
            step: [0.0; 3],
        };
        let half = [0, 1, 2].map(|i| 0.5 * bounds.hi[i] - 0.5 * bounds.lo[i]);
        let longest = half[0].max(half[1]).max(half[2]);
        for i in 0..3 {
            let scale = STEPS / half[i];
            frame.half_lo[i] = 0.5 * bounds.lo[i];
            // An axis without extent has one step, of no length.
            if scale.is_finite() {
                frame.scale[i] = scale;
                frame.step[i] = half[i] / longest;
            }
        }
        frame
    }

    /// A primitive with a box within the frame.
    #[inline(always)]
    pub fn prim(&self, number: u32, bounds: &Box4) -> Prim {
        let mut lanes = [0i16; 8];
        for i in 0..4 {
            let at = |x: f32| (0.5 * x - self.half_lo[i]) * self.scale[i] + FIRST + ROUND;
            lanes[i] = at(bounds.lo[i]).to_bits() as i16;
            lanes[i + 4] = !(at(bounds.hi[i]).to_bits() as i16);
        }
        lanes[3] = number as i16;
        lanes[7] = (number >> 16) as i16;
        Prim(lanes)
    }

    /// Half the surface of a box.
    #[inline(always)]
    pub fn half_area(&self, bounds: &Lanes) -> f32 {
        let x = bounds.extent(0) as f32 * self.step[0];
        let y = bounds.extent(1) as f32 * self.step[1];
        let z = bounds.extent(2) as f32 * self.step[2];
        x * (y + z) + y * z
    }
}

/// A box of a frame: the lower corner, a lane that means nothing, the upper one inverted, another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lanes([i16; 8]);

impl Lanes {
    /// What any box replaces.
    pub const EMPTY: Self = Self([i16::MAX; 8]);

    /// The smallest box around both.
    #[inline(always)]
    pub fn union(&self, prim: &Self) -> Self {
        let mut lanes = self.0;
        for (a, &b) in lanes.iter_mut().zip(&prim.0) {
            *a = (*a).min(b);
        }
        Self(lanes)
    }

    /// Steps along an axis; negative without any box.
    #[inline(always)]
    fn extent(&self, axis: usize) -> i32 {
        i32::from(!self.0[axis + 4]) - i32::from(self.0[axis])
    }
}

/// A primitive: its box in steps of a frame, and its number.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub struct Prim([i16; 8]);

impl Prim {
    /// One that stands for nothing.
    pub const NONE: Self = Self([0; 8]);

    /// The number it was given.
    #[inline(always)]
    pub fn number(&self) -> u32 {
        u32::from(self.0[3] as u16) | u32::from(self.0[7] as u16) << 16
    }

    /// Its box.
    #[inline(always)]
    pub fn bounds(&self) -> Lanes {
        Lanes(self.0)
    }

    /// Its centre, to half a step.
    #[inline(always)]
    pub fn center(&self, axis: usize) -> i16 {
        (self.0[axis] >> 1).wrapping_sub(self.0[axis + 4] >> 1)
    }
}

/// The box around a list of primitives, and that around their centres.
#[derive(Clone, Copy, Debug)]
pub struct Around {
    /// Around their boxes.
    pub bounds: Lanes,
    /// Lowest centre along each axis.
    pub lo: [i16; 3],
    /// Highest centre along each axis.
    pub hi: [i16; 3],
}

impl Around {
    /// The boxes around primitives, at least one.
    #[inline]
    pub fn of(prims: &[Prim]) -> Self {
        let mut bounds = Lanes::EMPTY;
        let mut centers = [i16::MAX; 8];
        for p in prims {
            bounds = bounds.union(&p.bounds());
            let mut c = [0; 8];
            for i in 0..4 {
                c[i] = (p.0[i] >> 1).wrapping_sub(p.0[i + 4] >> 1);
                c[i + 4] = !c[i];
            }
            for i in 0..8 {
                centers[i] = centers[i].min(c[i]);
            }
        }
        Self {
            bounds,
            lo: [centers[0], centers[1], centers[2]],
            hi: [!centers[4], !centers[5], !centers[6]],
        }
    }

    /// Steps between the centres along an axis.
    #[inline(always)]
    pub fn spread(&self, axis: usize) -> u32 {
        (i32::from(self.hi[axis]) - i32::from(self.lo[axis])).max(0) as u32
    }

    /// Steps between the centres along the axis where they are most.
    pub fn widest(&self) -> u32 {
        self.spread(0).max(self.spread(1)).max(self.spread(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_ends_of_f32_fit_a_frame() {
        let all = Box4::new([f32::MIN, 0.0, -1e-40], [f32::MAX, 0.0, 1e-40]);
        let frame = Frame::new(&all);
        let prim = frame.prim(0x1234_ABCD, &all);
        assert_eq!(prim.number(), 0x1234_ABCD);
        assert_eq!(prim.bounds().extent(0), 65534);
        assert_eq!(prim.bounds().extent(1), 0);
        assert!(frame.half_area(&prim.bounds()).is_finite());
    }

    proptest! {
        #[test]
        fn lanes_follow_their_boxes(c in prop::array::uniform6(-1e3f32..1e3), number in any::<u32>()) {
            let lo = [0, 1, 2].map(|i| c[i].min(c[i + 3]));
            let hi = [0, 1, 2].map(|i| c[i].max(c[i + 3]));
            let frame = Frame::new(&Box4::new([-1e3; 3], [1e3; 3]));
            let prim = frame.prim(number, &Box4::new(lo, hi));
            prop_assert_eq!(prim.number(), number);
            let step = 2e3 / STEPS;
            for i in 0..3 {
                let width = prim.bounds().extent(i) as f32 * step;
                prop_assert!((width - (hi[i] - lo[i])).abs() <= 1.5 * step);
                let center = (f32::from(prim.center(i)) + 32768.0) * step - 1e3;
                prop_assert!((center - (lo[i] + hi[i]) / 2.0).abs() <= 2.0 * step);
            }
            let around = Around::of(&[prim, prim]);
            prop_assert_eq!(around.lo, [0, 1, 2].map(|i| prim.center(i)));
            prop_assert_eq!(around.hi, around.lo);
            prop_assert_eq!(around.widest(), 0);
        }
    }
}

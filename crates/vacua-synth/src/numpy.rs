//! NumPy's numbers, bit for bit: its default random generator and its single-precision `exp`, `sin`
//! and `cos`, which are not correctly rounded. The benchmark scenes were made with NumPy (2.4, on
//! a processor with fused multiply-add), and figures compare only if the arrays are the same.
//!
//! The generator is PCG64 (O'Neill 2014, XSL-RR 128/64) seeded through a seed sequence (O'Neill
//! 2015, `seed_seq_fe`). The functions evaluate the published minimax approximations whose
//! coefficients NumPy (BSD-3-Clause) uses, with the same operations in the same order.

/// PCG64 as `numpy.random.default_rng(seed)` sets it up.
pub(crate) struct Pcg64 {
    state: u128,
    increment: u128,
}

const MULTIPLIER: u128 = 0x2360_ED05_1FC6_5DA4_4385_DF64_9FCC_F645;

impl Pcg64 {
    /// The generator of `default_rng(seed)`.
    pub fn new(seed: u32) -> Self {
        let words = seed_words(seed);
        let wide = |i: usize| u128::from(words[i]) << 64 | u128::from(words[i + 1]);
        let (initial, sequence) = (wide(0), wide(2));
        let increment = sequence << 1 | 1;
        let mut generator = Self {
            state: 0,
            increment,
        };
        generator.step();
        generator.state = generator.state.wrapping_add(initial);
        generator.step();
        generator
    }

    fn step(&mut self) {
        self.state = self
            .state
            .wrapping_mul(MULTIPLIER)
            .wrapping_add(self.increment);
    }

    /// 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        self.step();
        let folded = (self.state >> 64) as u64 ^ self.state as u64;
        folded.rotate_right((self.state >> 122) as u32)
    }

    /// `Generator.uniform(lo, hi)`.
    pub fn uniform(&mut self, lo: f64, hi: f64) -> f64 {
        let unit = (self.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64);
        lo + (hi - lo) * unit
    }
}

/// `SeedSequence(seed).generate_state(4, uint64)` for a seed of one word.
fn seed_words(seed: u32) -> [u64; 4] {
    const POOL: usize = 4;
    let mut hash = 0x43b0_d7e5u32;
    let mut hash_mix = |value: u32| {
        let value = value ^ hash;
        hash = hash.wrapping_mul(0x931e_8875);
        let value = value.wrapping_mul(hash);
        value ^ value >> 16
    };
    let mix = |x: u32, y: u32| {
        let r = x
            .wrapping_mul(0xca01_f9dd)
            .wrapping_sub(y.wrapping_mul(0x4973_f715));
        r ^ r >> 16
    };
    let mut pool = [0u32; POOL];
    for (i, word) in pool.iter_mut().enumerate() {
        *word = hash_mix(if i == 0 { seed } else { 0 });
    }
    for source in 0..POOL {
        for target in 0..POOL {
            if source != target {
                pool[target] = mix(pool[target], hash_mix(pool[source]));
            }
        }
    }
    let mut hash = 0x8b51_f9ddu32;
    let mut next = |word: u32| {
        let value = word ^ hash;
        hash = hash.wrapping_mul(0x58f3_8ded);
        let value = value.wrapping_mul(hash);
        u64::from(value ^ value >> 16)
    };
    let mut words = [0u64; 4];
    for (i, out) in words.iter_mut().enumerate() {
        let lo = next(pool[2 * i % POOL]);
        *out = next(pool[(2 * i + 1) % POOL]) << 32 | lo;
    }
    words
}

/// Adding and subtracting this rounds an `f32` of moderate size to the nearest integer.
const ROUND: f32 = 12_582_912.0;

/// A polynomial by Horner's rule with fused steps, highest coefficient first.
fn horner(coefficients: &[f32], x: f32) -> f32 {
    coefficients[1..]
        .iter()
        .fold(coefficients[0], |sum, &c| sum.mul_add(x, c))
}

/// `numpy.exp` of an `f32` of at most 0 (all that the scenes need): a ratio of polynomials after
/// reduction by ln 2.
pub(crate) fn exp_nonpositive(x: f32) -> f32 {
    if x <= -103.972_084 {
        return 0.0;
    }
    let k = (x * std::f32::consts::LOG2_E + ROUND) - ROUND;
    let y = k.mul_add(-1.428_606_8e-6, k.mul_add(-0.693_145_75, x));
    let numerator = [
        5.082_763e-4,
        6.757_897e-3,
        5.114_512e-2,
        2.473_615_4e-1,
        7.257_665e-1,
        1.0,
    ];
    let denominator = [2.159_509_4e-2, -2.742_335_4e-1, 1.0];
    let ratio = horner(&numerator, y) / horner(&denominator, y);
    // The factor 2^k, in f64 so that tiny results round once, as a scaling does.
    (f64::from(ratio) * f64::from_bits(((1023 + k as i64) as u64) << 52)) as f32
}

/// `numpy.sin` of an `f32` of moderate size.
pub(crate) fn sin(x: f32) -> f32 {
    sine_of_quadrant(x, 0)
}

/// `numpy.cos` of an `f32` of moderate size.
pub(crate) fn cos(x: f32) -> f32 {
    sine_of_quadrant(x, 1)
}

/// sin(x + quadrants · π/2), by reduction to ±π/4 and one polynomial for each of sine and cosine.
fn sine_of_quadrant(x: f32, quadrants: i32) -> f32 {
    let bits = f32::from_bits;
    let k = (x * std::f32::consts::FRAC_2_PI + ROUND) - ROUND;
    let y = k.mul_add(
        bits(0xA7C2_34C4),
        k.mul_add(bits(0xB4A8_885A), k.mul_add(bits(0xBFC9_0FD8), x)),
    );
    let y_sq = y * y;
    let quadrant = k as i32 + quadrants;
    let magnitude = if quadrant & 1 == 0 {
        let sine = [
            bits(0x363E_9DDE),
            bits(0xB950_35DD),
            bits(0x3C08_88CD),
            bits(0xBE2A_AAAB),
            0.0,
        ];
        horner(&sine, y_sq).mul_add(y, y)
    } else {
        let cosine = [
            bits(0x37CC_730B),
            bits(0xBAB6_036E),
            bits(0x3D2A_AA9E),
            -0.5,
            1.0,
        ];
        horner(&cosine, y_sq)
    };
    if quadrant & 2 == 2 {
        0.0 - magnitude
    } else {
        magnitude
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generator_is_numpys() {
        // numpy.random.default_rng(1).random(3)
        let mut rng = Pcg64::new(1);
        let got = [0; 3].map(|_| rng.uniform(0.0, 1.0));
        assert_eq!(
            got,
            [0.5118216247002567, 0.9504636963259353, 0.14415961271963373]
        );
    }

    #[test]
    fn the_functions_are_close_to_the_truth() {
        for i in 0..20_000 {
            let x = i as f32 * 0.002;
            assert!((f64::from(sin(x)) - f64::from(x).sin()).abs() < 1e-7, "{x}");
            assert!((f64::from(cos(x)) - f64::from(x).cos()).abs() < 1e-7, "{x}");
            let e = f64::from(-x).exp();
            assert!((f64::from(exp_nonpositive(-x)) - e).abs() < 3e-7 * e, "{x}");
        }
    }
}

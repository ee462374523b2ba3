//! Eight numbers at a time, in the widest registers that the processor has.
//!
//! All implementations give the same bits: each operation rounds, none are fused, and comparisons with NaN are false.

/// Numbers per operation: the elevations of a cone, or the triangles of a block.
pub const LANES: usize = 8;

/// Bit `n` is set where lane `n` is.
#[inline(always)]
pub(crate) fn bits(lanes: [bool; LANES]) -> u32 {
    lanes.iter().rev().fold(0, |bits, &lane| bits << 1 | u32::from(lane))
}

/// Instructions for vectors of [`LANES`] numbers.
pub(super) trait Lanes: Copy {
    type Values: Copy;
    type Mask: Copy;

    fn load(self, values: &[f32; LANES]) -> Self::Values;
    fn store(self, values: Self::Values) -> [f32; LANES];
    fn splat(self, value: f32) -> Self::Values;
    fn add(self, a: Self::Values, b: Self::Values) -> Self::Values;
    fn mul(self, a: Self::Values, b: Self::Values) -> Self::Values;
    fn div(self, a: Self::Values, b: Self::Values) -> Self::Values;
    /// The lesser of each pair; `b` if either is NaN.
    fn min(self, a: Self::Values, b: Self::Values) -> Self::Values;
    /// The greater of each pair; `b` if either is NaN.
    fn max(self, a: Self::Values, b: Self::Values) -> Self::Values;
    fn at_most(self, a: Self::Values, b: Self::Values) -> Self::Mask;
    fn both(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Bit `n` is set where lane `n` of the mask is.
    fn bits(self, mask: Self::Mask) -> u32;
}

/// Plain arithmetic, which the compiler turns into the platform's baseline vector instructions: SSE2, NEON.
#[derive(Debug, Clone, Copy)]
pub(super) struct Portable;

#[inline(always)]
fn pairwise<T: Copy + Default>(a: [f32; LANES], b: [f32; LANES], op: impl Fn(f32, f32) -> T) -> [T; LANES] {
    let mut results = [T::default(); LANES];
    for lane in 0..LANES {
        results[lane] = op(a[lane], b[lane]);
    }
    results
}

impl Lanes for Portable {
    type Values = [f32; LANES];
    type Mask = [bool; LANES];

    #[inline(always)]
    fn load(self, values: &[f32; LANES]) -> Self::Values {
        *values
    }

    #[inline(always)]
    fn store(self, values: Self::Values) -> [f32; LANES] {
        values
    }

    #[inline(always)]
    fn splat(self, value: f32) -> Self::Values {
        [value; LANES]
    }

    #[inline(always)]
    fn add(self, a: Self::Values, b: Self::Values) -> Self::Values {
        pairwise(a, b, |a, b| a + b)
    }

    #[inline(always)]
    fn mul(self, a: Self::Values, b: Self::Values) -> Self::Values {
        pairwise(a, b, |a, b| a * b)
    }

    #[inline(always)]
    fn div(self, a: Self::Values, b: Self::Values) -> Self::Values {
        pairwise(a, b, |a, b| a / b)
    }

    #[inline(always)]
    fn min(self, a: Self::Values, b: Self::Values) -> Self::Values {
        pairwise(a, b, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, a: Self::Values, b: Self::Values) -> Self::Values {
        pairwise(a, b, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn at_most(self, a: Self::Values, b: Self::Values) -> Self::Mask {
        pairwise(a, b, |a, b| a <= b)
    }

    #[inline(always)]
    fn both(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        let mut results = a;
        for (result, other) in results.iter_mut().zip(b) {
            *result &= other;
        }
        results
    }

    #[inline(always)]
    fn bits(self, mask: Self::Mask) -> u32 {
        bits(mask)
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{LANES, Lanes};
    use pulp::x86::V3;
    use std::arch::x86_64::{__m256, _CMP_LE_OQ};

    /// AVX2.
    impl Lanes for V3 {
        type Values = __m256;
        type Mask = __m256;

        #[inline(always)]
        fn load(self, values: &[f32; LANES]) -> Self::Values {
            pulp::bytemuck::cast(*values)
        }

        #[inline(always)]
        fn store(self, values: Self::Values) -> [f32; LANES] {
            pulp::bytemuck::cast(values)
        }

        #[inline(always)]
        fn splat(self, value: f32) -> Self::Values {
            self.avx._mm256_set1_ps(value)
        }

        #[inline(always)]
        fn add(self, a: Self::Values, b: Self::Values) -> Self::Values {
            self.avx._mm256_add_ps(a, b)
        }

        #[inline(always)]
        fn mul(self, a: Self::Values, b: Self::Values) -> Self::Values {
            self.avx._mm256_mul_ps(a, b)
        }

        #[inline(always)]
        fn div(self, a: Self::Values, b: Self::Values) -> Self::Values {
            self.avx._mm256_div_ps(a, b)
        }

        #[inline(always)]
        fn min(self, a: Self::Values, b: Self::Values) -> Self::Values {
            self.avx._mm256_min_ps(a, b)
        }

        #[inline(always)]
        fn max(self, a: Self::Values, b: Self::Values) -> Self::Values {
            self.avx._mm256_max_ps(a, b)
        }

        #[inline(always)]
        fn at_most(self, a: Self::Values, b: Self::Values) -> Self::Mask {
            self.avx._mm256_cmp_ps::<_CMP_LE_OQ>(a, b)
        }

        #[inline(always)]
        fn both(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
            self.avx._mm256_and_ps(a, b)
        }

        #[inline(always)]
        fn bits(self, mask: Self::Mask) -> u32 {
            self.avx._mm256_movemask_ps(mask) as u32
        }
    }
}

//! Filters: what turns decoded attributes into numbers (appendix B of the specification).

use std::f32::consts::FRAC_1_SQRT_2;

/// Turns a number with a mantissa of 24 bits and an exponent of 8, both signed, into an `f32`.
pub(super) fn apply_exponent(word: &mut [u8; 4]) {
    let (mantissa, exponent) = (i32::from_le_bytes(*word) << 8 >> 8, i32::from_le_bytes(*word) >> 24);
    let scale = f32::from_bits(((exponent + 127) as u32) << 23);
    *word = (scale * mantissa as f32).to_le_bytes();
}

/// Turns three components of a unit quaternion into four normalized 16-bit numbers. The last number of the element
/// stands for 1, except for its lowest two bits: they tell which component, the largest, is left out.
pub(super) fn restore_rotation(element: &mut [u8; 8]) {
    let [x, y, z, last] = [0, 2, 4, 6].map(|at| i16::from_le_bytes([element[at], element[at + 1]]));
    let scale = FRAC_1_SQRT_2 / f32::from(last | 3);
    let [x, y, z] = [x, y, z].map(|component| f32::from(component) * scale);
    let largest = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    for (turn, component) in [largest, x, y, z].into_iter().enumerate() {
        let at = 2 * ((usize::from(last as u16 & 3) + turn) % 4);
        element[at..at + 2].copy_from_slice(&((component * f32::from(i16::MAX)).round() as i16).to_le_bytes());
    }
}

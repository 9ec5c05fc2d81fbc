//! Non-linearities over whole slices, in plain arithmetic that the compiler turns into vectors.

use super::policy_model::Activation;

/// Beyond these eˣ leaves the range of 32-bit floats.
const LOWEST: f32 = -87.0;
const HIGHEST: f32 = 88.0;
/// Added and taken away again, it rounds to a whole number; its lowest bits then are that number.
const ROUND: f32 = 12_582_912.0;
const ONE_BITS: u32 = 0x3f80_0000;
const MANTISSA_BITS: u32 = 23;
/// ln 2 in two parts, so that a multiple of it loses nothing: the first has few bits.
const LN_2_FIRST: f32 = 0.693_359_4;
const LN_2_REST: f32 = -0.000_212_194_44;
/// 1 / k! from k = 6 down to 2.
const TAYLOR: [f32; 5] = [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5];

/// Returns eˣ to about one part in 10⁷; 0 and infinity are never reached.
#[inline]
pub(super) fn exp(x: f32) -> f32 {
    // x = k ln 2 + rest, and 2ᵏ is written into the exponent.
    let x = x.clamp(LOWEST, HIGHEST);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let whole = shifted - ROUND;
    let rest = x - whole * LN_2_FIRST - whole * LN_2_REST;
    let mut sum = TAYLOR[0];
    for coefficient in &TAYLOR[1..] {
        sum = sum * rest + coefficient;
    }
    let power = (shifted.to_bits() << MANTISSA_BITS).wrapping_add(ONE_BITS);
    (sum * rest * rest + rest + 1.0) * f32::from_bits(power)
}

/// Returns 1 / (1 + e⁻ˣ).
#[inline]
pub(super) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// Returns tanh *x*, off by some 10⁻⁷.
#[inline]
pub(super) fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (1.0 + exp(2.0 * x))
}

/// Applies a non-linearity to every element.
pub(super) fn activate(activation: Activation, values: &mut [f32]) {
    match activation {
        Activation::None => {}
        Activation::Tanh => apply(values, tanh),
        Activation::Relu => apply(values, |x| x.max(0.0)),
        Activation::Elu => apply(values, |x| if x > 0.0 { x } else { exp(x) - 1.0 }),
        Activation::Silu => apply(values, |x| x * sigmoid(x)),
    }
}

#[inline]
fn apply(values: &mut [f32], function: impl Fn(f32) -> f32) {
    for value in values {
        *value = function(*value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers() -> impl Iterator<Item = f32> {
        (-200_000..200_000).map(|number| number as f32 * 5e-4)
    }

    #[test]
    fn exp_is_that_of_the_system() {
        for x in numbers().filter(|x| (LOWEST..HIGHEST).contains(x)) {
            let expected = f64::from(x).exp();
            let error = (f64::from(exp(x)) - expected).abs() / expected;
            assert!(error < 3e-7, "exp({x}) is off by {error}");
        }
        assert!(exp(-1e30) < 1e-37 && exp(1e30).is_finite());
    }

    #[test]
    fn the_others_are_right_to_a_few_parts_in_ten_million() {
        for x in numbers() {
            let wide = f64::from(x);
            let logistic = 1.0 / (1.0 + (-wide).exp());
            let pairs = [
                (Activation::None, wide),
                (Activation::Tanh, wide.tanh()),
                (Activation::Relu, wide.max(0.0)),
                (
                    Activation::Elu,
                    if wide > 0.0 { wide } else { wide.exp_m1() },
                ),
                (Activation::Silu, wide * logistic),
            ];
            for (activation, expected) in pairs {
                let mut found = [x];
                activate(activation, &mut found);
                let error = (f64::from(found[0]) - expected).abs() / expected.abs().max(1.0);
                assert!(error < 4e-7, "{activation:?} of {x} is off by {error}");
            }
        }
    }

    #[test]
    fn what_is_no_number_stays_none() {
        assert!(exp(f32::NAN).is_nan() && tanh(f32::NAN).is_nan() && sigmoid(f32::NAN).is_nan());
    }
}

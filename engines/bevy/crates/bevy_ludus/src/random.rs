//! Random numbers that are the same on every machine.

use std::ops::Range;

/// Golden ratio of splitmix64; it spreads neighbouring seeds far apart.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The random stream of one world: xoshiro256++ of Blackman and Vigna, seeded by splitmix64.
///
/// Use nothing else for randomness in a game, so that equal seeds play equal episodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RandomStream {
    state: [u64; 4],
}

impl RandomStream {
    /// Starts the stream of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut state = seed;
        let next = |_| {
            state = state.wrapping_add(STEP);
            mix(state)
        };
        Self {
            state: [0, 1, 2, 3].map(next),
        }
    }

    /// Starts the stream of a world's episode: a function of the world's seed and of the number of
    /// the episode only.
    #[must_use]
    pub fn of_episode(seed: u64, episode: u64) -> Self {
        Self::new(mix(seed.wrapping_add(STEP)) ^ episode.wrapping_mul(0xd1b5_4a32_d192_ed03))
    }

    /// Returns 64 random bits.
    pub fn bits(&mut self) -> u64 {
        let s = &mut self.state;
        let result = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let shifted = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= shifted;
        s[3] = s[3].rotate_left(45);
        result
    }

    /// Returns a number from 0 up to, but without, 1.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1_u32 << 24) as f32
    }

    /// Returns a number of a range.
    pub fn range(&mut self, range: Range<f32>) -> f32 {
        range.start + (range.end - range.start) * self.unit()
    }

    /// Returns a whole number from 0 to `count` − 1; 0 if `count` is 0.
    pub fn below(&mut self, count: u64) -> u64 {
        // Lemire's multiplication; its bias is below 2⁻⁴⁴ for counts below a million.
        ((u128::from(self.bits()) * u128::from(count)) >> 64) as u64
    }
}

/// The output function of splitmix64.
fn mix(value: u64) -> u64 {
    let value = (value ^ value >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let value = (value ^ value >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    value ^ value >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splitmix_and_xoshiro_are_those_of_their_authors() {
        // First outputs of the reference implementations: splitmix64 of 0, and xoshiro256++ of
        // the state 1, 2, 3, 4.
        assert_eq!(RandomStream::new(0).state[0], 0xe220_a839_7b1d_cdaf);
        let mut stream = RandomStream {
            state: [1, 2, 3, 4],
        };
        let first = [stream.bits(), stream.bits(), stream.bits()];
        assert_eq!(first, [41_943_041, 58_720_359, 3_588_806_011_781_223]);
    }

    #[test]
    fn episodes_and_seeds_have_streams_of_their_own() {
        let first = |seed, episode| RandomStream::of_episode(seed, episode).bits();
        let all = [first(0, 1), first(0, 2), first(1, 1), first(1, 2)];
        for (index, one) in all.iter().enumerate() {
            assert!(!all[..index].contains(one));
        }
        assert_eq!(first(1, 2), first(1, 2));
    }

    #[test]
    fn numbers_fill_their_ranges() {
        let mut stream = RandomStream::new(7);
        let numbers: Vec<_> = (0..10_000).map(|_| stream.range(-2.0..6.0)).collect();
        assert!(numbers.iter().all(|number| (-2.0..6.0).contains(number)));
        let mean = numbers.iter().sum::<f32>() / 10_000.0;
        assert!((mean - 2.0).abs() < 0.1, "{mean}");
        let mut counts = [0; 3];
        for _ in 0..3000 {
            counts[stream.below(3) as usize] += 1;
        }
        assert!(
            counts.iter().all(|count| (900..1100).contains(count)),
            "{counts:?}"
        );
        assert_eq!(stream.below(0), 0);
    }
}

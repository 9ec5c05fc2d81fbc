//! From outputs to actions (POLICY.md §4).

use super::activation::tanh;
use super::policy_model::PolicyModel;
use crate::random::RandomStream;
use std::f32::consts::TAU;

/// How outputs become an action.
#[derive(Clone, Debug)]
pub struct ActionHead {
    choices: Vec<usize>,
    /// Of each number, lowest and highest.
    bounds: Vec<(f32, f32)>,
    num_logits: usize,
    /// None where the network puts them out.
    log_std: Option<Vec<f32>>,
    log_std_range: [f32; 2],
    is_squashed: bool,
}

impl ActionHead {
    /// Takes what a policy says of its actions.
    #[must_use]
    pub fn new(model: &PolicyModel) -> Self {
        let choices: Vec<_> = model.choices().collect();
        let distribution = &model.distribution;
        Self {
            num_logits: choices.iter().sum(),
            choices,
            bounds: model.bounds().collect(),
            log_std: distribution
                .log_std
                .as_ref()
                .map(|tensor| tensor.data.clone()),
            log_std_range: distribution.log_std_range,
            is_squashed: distribution.is_squashed,
        }
    }

    /// Returns how many choices an action has.
    #[must_use]
    pub fn num_choices(&self) -> usize {
        self.choices.len()
    }

    /// Returns how many numbers an action has.
    #[must_use]
    pub fn num_numbers(&self) -> usize {
        self.bounds.len()
    }

    /// Decides for one agent.
    ///
    /// An empty `mask` allows everything, otherwise it has a byte per alternative of all choices, and
    /// what is 0 is not taken. Without `random` the most probable action is taken.
    ///
    /// # Panics
    /// `outputs`, `mask`, `choices` or `numbers` are too short.
    pub fn choose(
        &self,
        outputs: &[f32],
        mask: &[u8],
        mut random: Option<&mut RandomStream>,
        choices: &mut [i64],
        numbers: &mut [f32],
    ) {
        let mut start = 0;
        for (choice, n) in choices.iter_mut().zip(&self.choices) {
            let range = start..start + n;
            let mask = if mask.is_empty() {
                mask
            } else {
                &mask[range.clone()]
            };
            let taken = match &mut random {
                Some(random) => draw(&outputs[range], mask, random),
                None => best(&outputs[range], mask),
            };
            *choice = taken as i64;
            start += n;
        }
        for (element, number) in numbers.iter_mut().enumerate() {
            let mut value = outputs[self.num_logits + element];
            if let Some(random) = &mut random {
                value += self.log_std(outputs, element).exp() * normal(random);
            }
            *number = self.stretch(value, element);
        }
    }

    /// Returns the log deviation of a number.
    ///
    /// # Panics
    /// There is no such number.
    #[must_use]
    pub fn log_std(&self, outputs: &[f32], element: usize) -> f32 {
        let [lowest, highest] = self.log_std_range;
        match &self.log_std {
            Some(log_std) => log_std[element],
            None => outputs[self.num_logits + self.bounds.len() + element].clamp(lowest, highest),
        }
    }

    /// Brings a number into its bounds.
    fn stretch(&self, value: f32, element: usize) -> f32 {
        let (low, high) = self.bounds[element];
        let unit = if self.is_squashed {
            tanh(value)
        } else {
            value.clamp(-1.0, 1.0)
        };
        (low + (high - low) * (unit * 0.5 + 0.5)).max(low).min(high)
    }
}

fn is_allowed(mask: &[u8], index: usize) -> bool {
    mask.get(index).is_none_or(|allowed| *allowed != 0)
}

/// Returns the largest logit that is allowed, the first of equal ones; 0 if none is.
fn best(logits: &[f32], mask: &[u8]) -> usize {
    let (mut best, mut highest) = (0, f32::NEG_INFINITY);
    for (index, logit) in logits.iter().enumerate() {
        if *logit > highest && is_allowed(mask, index) {
            (best, highest) = (index, *logit);
        }
    }
    best
}

/// Draws from the softmax of the logits that are allowed.
fn draw(logits: &[f32], mask: &[u8], random: &mut RandomStream) -> usize {
    let best = best(logits, mask);
    let weight = |index: usize| match is_allowed(mask, index) {
        true => (logits[index] - logits[best]).exp(),
        false => 0.0,
    };
    let total: f32 = (0..logits.len()).map(weight).sum();
    let mut rest = random.unit() * total;
    for index in (0..logits.len()).filter(|index| is_allowed(mask, *index)) {
        rest -= weight(index);
        if rest < 0.0 {
            return index;
        }
    }
    best
}

/// Draws a standard normal number, after Box and Muller (1958).
fn normal(random: &mut RandomStream) -> f32 {
    let radius = (-2.0 * (1.0 - random.unit()).ln()).sqrt();
    radius * (TAU * random.unit()).cos()
}

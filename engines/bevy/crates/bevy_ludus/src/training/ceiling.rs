//! Random play inside the engine, to show how fast the game could be without a trainer.

use crate::random::RandomStream;
use crate::wire::{ActionFrame, ActionKind, PolicySpec, Spec};
use std::time::{Duration, Instant};

/// One measurement.
#[derive(Debug)]
pub(crate) struct Ceiling {
    pub id: u64,
    pub num_steps: u64,
    steps_left: u64,
    random: RandomStream,
    began: Instant,
}

impl Ceiling {
    pub fn new(id: u64, num_steps: u64, seed: u64) -> Self {
        let num_steps = num_steps.max(1);
        let random = RandomStream::new(seed);
        Self {
            id,
            num_steps,
            steps_left: num_steps,
            random,
            began: Instant::now(),
        }
    }

    /// Draws the actions of the next step. Returns how long all steps took once they are over.
    pub fn advance(&mut self, spec: &Spec, actions: &mut ActionFrame) -> Option<Duration> {
        if self.steps_left == 0 {
            return Some(self.began.elapsed());
        }
        self.steps_left -= 1;
        for (index, policy) in spec.policies.iter().enumerate() {
            self.draw_choices(index, policy, actions);
            self.draw_numbers(index, policy, actions);
        }
        None
    }

    fn draw_choices(&mut self, index: usize, policy: &PolicySpec, actions: &mut ActionFrame) {
        let choices: Vec<u64> = policy.choices().collect();
        let bytes = actions.discrete_mut(index);
        for (bytes, n) in bytes.iter_mut().zip(choices.iter().cycle()) {
            *bytes = self.random.below(*n).to_le_bytes();
        }
    }

    fn draw_numbers(&mut self, index: usize, policy: &PolicySpec, actions: &mut ActionFrame) {
        let bounds = bounds_of(policy);
        let bytes = actions.continuous_mut(index);
        for (bytes, (low, high)) in bytes.iter_mut().zip(bounds.iter().cycle()) {
            *bytes = self.random.range(*low..*high).to_le_bytes();
        }
    }
}

fn bounds_of(policy: &PolicySpec) -> Vec<(f32, f32)> {
    let mut bounds = Vec::with_capacity(policy.continuous_size());
    for component in &policy.action {
        if let ActionKind::Continuous { size, low, high } = &component.kind {
            let of = |element| {
                (
                    low.of(element).unwrap_or(-1.0),
                    high.of(element).unwrap_or(1.0),
                )
            };
            let pairs = (0..*size as usize).map(of);
            bounds.extend(pairs.map(|(low, high)| (low as f32, high as f32)));
        }
    }
    bounds
}

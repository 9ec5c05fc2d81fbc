//! The memory of a policy, a gated recurrent unit (POLICY.md §3.4).

use super::activation::{sigmoid, tanh};
use super::dense::Dense;
use super::fields::Tensor;
use super::policy_model::{Activation, Memory};

/// A memory for some agents at once.
#[derive(Clone, Debug)]
pub(super) struct Gru {
    input: Dense,
    hidden: Dense,
    /// What observations and states add to the gates, three parts for each agent.
    from_input: Vec<f32>,
    from_state: Vec<f32>,
    pub size: usize,
}

impl Gru {
    /// Makes a memory for `capacity` agents at once.
    pub fn new(memory: &Memory, capacity: usize) -> Self {
        let size = memory.size();
        Self {
            input: gates(&memory.weight_input, &memory.bias_input),
            hidden: gates(&memory.weight_hidden, &memory.bias_hidden),
            from_input: vec![0.0; 3 * size * capacity],
            from_state: vec![0.0; 3 * size * capacity],
            size,
        }
    }

    /// Moves states, `[n, size]`, on by what agents see, `[n, inputs]`.
    pub fn advance(&mut self, seen: &[f32], states: &mut [f32]) {
        let num_gates = states.len() * 3;
        let from_input = &mut self.from_input[..num_gates];
        let from_state = &mut self.from_state[..num_gates];
        self.input.run(seen, from_input);
        self.hidden.run(states, from_state);
        let size = self.size;
        let parts = from_input
            .chunks_exact(3 * size)
            .zip(from_state.chunks_exact(3 * size));
        for (state, (x, h)) in states.chunks_exact_mut(size).zip(parts) {
            let (x_reset, x) = x.split_at(size);
            let (h_reset, h) = h.split_at(size);
            let (x_update, x_new) = x.split_at(size);
            let (h_update, h_new) = h.split_at(size);
            for i in 0..size {
                let reset = sigmoid(x_reset[i] + h_reset[i]);
                let update = sigmoid(x_update[i] + h_update[i]);
                let new = tanh(x_new[i] + reset * h_new[i]);
                state[i] = new + update * (state[i] - new);
            }
        }
    }
}

fn gates(weight: &Tensor, bias: &Tensor) -> Dense {
    let inputs = weight.data.len() / bias.data.len();
    Dense::pack(&bias.data, inputs, Activation::None, |output, input| {
        weight.data[output * inputs + input]
    })
}

//! Dense layers, packed so that plain loops become vector instructions.

use super::activation::activate;
use super::policy_model::{Activation, Linear};

/// Outputs that are computed together.
const LANES: usize = 16;

/// A dense layer.
#[derive(Clone, Debug)]
pub(super) struct Dense {
    /// By block of outputs, then by input: the weights of the block's outputs.
    weight: Vec<[f32; LANES]>,
    bias: Vec<[f32; LANES]>,
    activation: Activation,
    pub inputs: usize,
    pub outputs: usize,
}

impl Dense {
    pub fn new(layer: &Linear) -> Self {
        let (weight, bias) = (&layer.weight.data, &layer.bias.data);
        let inputs = weight.len() / bias.len();
        Self::pack(bias, inputs, layer.activation, |output, input| {
            weight[output * inputs + input]
        })
    }

    /// Packs the weights that `weight(output, input)` returns.
    pub fn pack(
        bias: &[f32],
        inputs: usize,
        activation: Activation,
        weight: impl Fn(usize, usize) -> f32,
    ) -> Self {
        let outputs = bias.len();
        let num_blocks = outputs.div_ceil(LANES);
        let mut packed = vec![[0.0; LANES]; num_blocks * inputs];
        let mut biases = vec![[0.0; LANES]; num_blocks];
        for (output, bias) in bias.iter().enumerate() {
            let (block, lane) = (output / LANES, output % LANES);
            biases[block][lane] = *bias;
            for input in 0..inputs {
                packed[block * inputs + input][lane] = weight(output, input);
            }
        }
        Self {
            weight: packed,
            bias: biases,
            activation,
            inputs,
            outputs,
        }
    }

    /// Computes rows of outputs, `[n, outputs]`, of rows of inputs, `[n, inputs]`.
    pub fn run(&self, rows: &[f32], outputs: &mut [f32]) {
        let paired = rows.len() / (2 * self.inputs) * 2;
        let (pairs, last) = rows.split_at(paired * self.inputs);
        let (pairs_out, last_out) = outputs.split_at_mut(paired * self.outputs);
        // Block by block, as the weights of one are used again for all rows.
        for block in 0..self.bias.len() {
            let rows = pairs.chunks_exact(2 * self.inputs);
            for (rows, outputs) in rows.zip(pairs_out.chunks_exact_mut(2 * self.outputs)) {
                let (first, second) = rows.split_at(self.inputs);
                let (first_out, second_out) = outputs.split_at_mut(self.outputs);
                let [one, two] = self.block(block, [first, second]);
                put(&one, block, first_out);
                put(&two, block, second_out);
            }
            if !last.is_empty() {
                let [one] = self.block(block, [last]);
                put(&one, block, last_out);
            }
        }
        activate(self.activation, outputs);
    }

    /// Computes one block of outputs of some rows.
    #[inline]
    fn block<const ROWS: usize>(&self, block: usize, rows: [&[f32]; ROWS]) -> [[f32; LANES]; ROWS] {
        let weight = &self.weight[block * self.inputs..(block + 1) * self.inputs];
        let rows = rows.map(|row| &row[..weight.len()]);
        let mut sums = [self.bias[block]; ROWS];
        for (input, column) in weight.iter().enumerate() {
            for (row, sums) in rows.iter().zip(&mut sums) {
                let x = row[input];
                for (sum, weight) in sums.iter_mut().zip(column) {
                    *sum += weight * x;
                }
            }
        }
        sums
    }
}

#[inline]
fn put(sums: &[f32; LANES], block: usize, outputs: &mut [f32]) {
    let start = block * LANES;
    match outputs.get_mut(start..start + LANES) {
        Some(whole) => whole.copy_from_slice(sums),
        None => {
            let part = &mut outputs[start..];
            part.copy_from_slice(&sums[..part.len()]);
        }
    }
}

//! The auto-encoder: four linear layers with forward and backward pass, and Adam.
//!
//! 32 -> 24 -> ReLU -> k -> unit length | unit length -> 24 -> ReLU -> 32 -> unit length. The loss
//! is the mean of |x - y| over entries plus 0.6 times the mean of 1 - cos(x, y) over rows (paper
//! eq. 4). All numbers are f64: the network is small, and gradients can be tested with finite
//! differences.

use crate::pipeline::network::GENERIC_SIZE;
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Width of the hidden layers.
const HIDDEN: usize = 24;
/// Weight of the cosine term.
const COSINE_WEIGHT: f64 = 0.6;
/// Added to squared lengths, so that zero vectors stay finite.
const EPSILON: f64 = 1e-12;

/// One linear layer within the parameters: weights `[outputs, inputs]`, then biases `[outputs]`.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Layer {
    inputs: usize,
    outputs: usize,
    start: usize,
}

impl Layer {
    fn weights<'a>(&self, parameters: &'a [f64]) -> &'a [f64] {
        &parameters[self.start..self.start + self.inputs * self.outputs]
    }

    fn end(&self) -> usize {
        self.start + (self.inputs + 1) * self.outputs
    }

    fn biases<'a>(&self, parameters: &'a [f64]) -> &'a [f64] {
        &parameters[self.start + self.inputs * self.outputs..self.end()]
    }

    /// y = W x + b for each row.
    fn forward(&self, parameters: &[f64], rows: &[f64]) -> Vec<f64> {
        let (weights, biases) = (self.weights(parameters), self.biases(parameters));
        let mut found = Vec::with_capacity(rows.len() / self.inputs * self.outputs);
        for row in rows.chunks_exact(self.inputs) {
            for (weights, bias) in weights.chunks_exact(self.inputs).zip(biases) {
                found.push(bias + dot(weights, row));
            }
        }
        found
    }

    /// Adds dL/dW and dL/db to `gradient`; returns dL/dx of each row.
    fn backward(
        &self,
        parameters: &[f64],
        rows: &[f64],
        to_output: &[f64],
        gradient: &mut [f64],
    ) -> Vec<f64> {
        let weights = self.weights(parameters);
        let (to_weights, to_biases) =
            gradient[self.start..self.end()].split_at_mut(self.inputs * self.outputs);
        let mut to_input = vec![0.0; rows.len()];
        let per_row = rows
            .chunks_exact(self.inputs)
            .zip(to_output.chunks_exact(self.outputs))
            .zip(to_input.chunks_exact_mut(self.inputs));
        for ((row, to_row), to_input) in per_row {
            for (output, &upstream) in to_row.iter().enumerate() {
                let at = output * self.inputs..(output + 1) * self.inputs;
                to_biases[output] += upstream;
                add_scaled(&mut to_weights[at.clone()], upstream, row);
                add_scaled(to_input, upstream, &weights[at]);
            }
        }
        to_input
    }
}

/// Activations of a forward pass, for the backward pass.
struct Trace {
    hidden_in: Vec<f64>,
    raw_code: Vec<f64>,
    code: Vec<f64>,
    hidden_out: Vec<f64>,
    raw_output: Vec<f64>,
    output: Vec<f64>,
}

/// The auto-encoder.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Net {
    layers: [Layer; 4],
    pub parameters: Vec<f64>,
}

impl Net {
    /// Weights and biases uniform in ±1/√inputs.
    pub fn new(code_size: usize, random: &mut impl Rng) -> Self {
        let sizes = [GENERIC_SIZE, HIDDEN, code_size, HIDDEN, GENERIC_SIZE];
        let mut start = 0;
        let layers = std::array::from_fn(|i| {
            let layer = Layer { inputs: sizes[i], outputs: sizes[i + 1], start };
            start = layer.end();
            layer
        });
        let mut parameters = Vec::with_capacity(start);
        for layer in &layers {
            let bound = 1.0 / (layer.inputs as f64).sqrt();
            let count = layer.end() - layer.start;
            parameters.extend((0..count).map(|_| random.random_range(-bound..bound)));
        }
        Self { layers, parameters }
    }

    pub fn code_size(&self) -> usize {
        self.layers[1].outputs
    }

    /// `[n, 32]` -> `[n, code_size]`, unit length.
    pub fn encode(&self, rows: &[f64]) -> Vec<f64> {
        let hidden = relu(self.layers[0].forward(&self.parameters, rows));
        unit(&self.layers[1].forward(&self.parameters, &hidden), self.code_size())
    }

    /// `[n, code_size]` of any length -> `[n, 32]`, unit length.
    pub fn decode(&self, codes: &[f64]) -> Vec<f64> {
        let code = unit(codes, self.code_size());
        let hidden = relu(self.layers[2].forward(&self.parameters, &code));
        unit(&self.layers[3].forward(&self.parameters, &hidden), GENERIC_SIZE)
    }

    fn trace(&self, rows: &[f64]) -> Trace {
        let [first, second, third, fourth] = &self.layers;
        let hidden_in = relu(first.forward(&self.parameters, rows));
        let raw_code = second.forward(&self.parameters, &hidden_in);
        let code = unit(&raw_code, self.code_size());
        let hidden_out = relu(third.forward(&self.parameters, &code));
        let raw_output = fourth.forward(&self.parameters, &hidden_out);
        let output = unit(&raw_output, GENERIC_SIZE);
        Trace { hidden_in, raw_code, code, hidden_out, raw_output, output }
    }

    /// The loss over a batch `[n, 32]` and its gradient to all parameters.
    pub fn loss_and_gradient(&self, rows: &[f64]) -> (f64, Vec<f64>) {
        let trace = self.trace(rows);
        let mut gradient = vec![0.0; self.parameters.len()];
        let (loss, to_output) = loss(rows, &trace.output);
        let [first, second, third, fourth] = &self.layers;
        let parameters = &self.parameters;

        let to_raw = unit_backward(&trace.raw_output, &to_output, GENERIC_SIZE);
        let to_hidden = fourth.backward(parameters, &trace.hidden_out, &to_raw, &mut gradient);
        let to_hidden = relu_backward(&trace.hidden_out, to_hidden);
        let to_code = third.backward(parameters, &trace.code, &to_hidden, &mut gradient);
        let to_raw = unit_backward(&trace.raw_code, &to_code, self.code_size());
        let to_hidden = second.backward(parameters, &trace.hidden_in, &to_raw, &mut gradient);
        let to_hidden = relu_backward(&trace.hidden_in, to_hidden);
        first.backward(parameters, rows, &to_hidden, &mut gradient);
        (loss, gradient)
    }
}

/// The loss and its gradient with respect to `output`. `output` has unit length, `target` may have
/// any.
fn loss(target: &[f64], output: &[f64]) -> (f64, Vec<f64>) {
    let rows = (target.len() / GENERIC_SIZE) as f64;
    let entries = target.len() as f64;
    let mut loss = 0.0;
    let mut gradient = Vec::with_capacity(output.len());
    for (target, output) in target.chunks_exact(GENERIC_SIZE).zip(output.chunks_exact(GENERIC_SIZE))
    {
        let scale = 1.0 / length(target);
        loss += COSINE_WEIGHT * (1.0 - dot(target, output) * scale) / rows;
        for (&target, &output) in target.iter().zip(output) {
            let difference = output - target;
            loss += difference.abs() / entries;
            gradient.push(difference.signum() / entries - COSINE_WEIGHT * target * scale / rows);
        }
    }
    (loss, gradient)
}

fn relu(mut values: Vec<f64>) -> Vec<f64> {
    values.iter_mut().for_each(|value| *value = value.max(0.0));
    values
}

fn relu_backward(values: &[f64], mut upstream: Vec<f64>) -> Vec<f64> {
    for (upstream, &value) in upstream.iter_mut().zip(values) {
        if value <= 0.0 {
            *upstream = 0.0;
        }
    }
    upstream
}

fn length(row: &[f64]) -> f64 {
    (dot(row, row) + EPSILON).sqrt()
}

fn unit(rows: &[f64], channels: usize) -> Vec<f64> {
    let scaled = |row: &[f64]| {
        let scale = 1.0 / length(row);
        row.iter().map(|value| value * scale).collect::<Vec<_>>()
    };
    rows.chunks_exact(channels).flat_map(scaled).collect()
}

/// u = x / |x|: dL/dx = (g - u (u·g)) / |x|.
fn unit_backward(rows: &[f64], upstream: &[f64], channels: usize) -> Vec<f64> {
    let mut found = Vec::with_capacity(rows.len());
    for (row, upstream) in rows.chunks_exact(channels).zip(upstream.chunks_exact(channels)) {
        let scale = 1.0 / length(row);
        let along = dot(row, upstream) * scale * scale;
        found.extend(row.iter().zip(upstream).map(|(x, g)| (g - x * along) * scale));
    }
    found
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add_scaled(to: &mut [f64], scale: f64, from: &[f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += scale * from);
}

/// Adam (Kingma and Ba 2015) with its default constants.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Adam {
    rate: f64,
    steps: i32,
    first: Vec<f64>,
    second: Vec<f64>,
}

impl Adam {
    const DECAY_FIRST: f64 = 0.9;
    const DECAY_SECOND: f64 = 0.999;
    const EPSILON: f64 = 1e-8;

    pub fn new(rate: f64, parameters: usize) -> Self {
        Self { rate, steps: 0, first: vec![0.0; parameters], second: vec![0.0; parameters] }
    }

    pub fn step(&mut self, parameters: &mut [f64], gradient: &[f64]) {
        self.steps = self.steps.saturating_add(1);
        let correct_first = 1.0 - Self::DECAY_FIRST.powi(self.steps);
        let correct_second = 1.0 - Self::DECAY_SECOND.powi(self.steps);
        for (at, (parameter, &gradient)) in parameters.iter_mut().zip(gradient).enumerate() {
            let (first, second) = (&mut self.first[at], &mut self.second[at]);
            *first += (1.0 - Self::DECAY_FIRST) * (gradient - *first);
            *second += (1.0 - Self::DECAY_SECOND) * (gradient * gradient - *second);
            let spread = (*second / correct_second).sqrt() + Self::EPSILON;
            *parameter -= self.rate * (*first / correct_first) / spread;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn batch(random: &mut ChaCha8Rng) -> Vec<f64> {
        let rows: Vec<f64> =
            (0..7 * GENERIC_SIZE).map(|_| random.random_range(-1.0..1.0)).collect();
        unit(&rows, GENERIC_SIZE)
    }

    /// Largest difference between the gradient and central differences of the loss, relative to
    /// the gradient's largest entry.
    fn worst(net: &Net, rows: &[f64], gradient: &[f64]) -> f64 {
        let step = 1e-6;
        let largest = gradient.iter().fold(0.0_f64, |most, g| most.max(g.abs()));
        let at = |index: usize, by: f64| {
            let mut moved = net.clone();
            moved.parameters[index] += by;
            loss(rows, &moved.trace(rows).output).0
        };
        (0..gradient.len())
            .map(|i| ((at(i, step) - at(i, -step)) / (2.0 * step) - gradient[i]).abs() / largest)
            .fold(0.0, f64::max)
    }

    #[test]
    fn the_gradient_matches_finite_differences() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let net = Net::new(15, &mut random);
        let rows = batch(&mut random);
        let (_, gradient) = net.loss_and_gradient(&rows);
        let error = worst(&net, &rows, &gradient);
        assert!(error < 1e-6, "{error:e}");

        // Negative control: an error of a hundredth of the largest entry is detected.
        let mut wrong = gradient.clone();
        let largest = gradient.iter().fold(0.0_f64, |most, g| most.max(g.abs()));
        wrong[3] += 0.01 * largest;
        let error = worst(&net, &rows, &wrong);
        assert!(error > 5e-3, "{error:e}");
    }

    #[test]
    fn adam_s_first_step_has_the_size_of_its_rate() {
        let mut parameters = [1.0, 1.0, 1.0];
        Adam::new(0.1, 3).step(&mut parameters, &[2.0, -0.5, 0.0]);
        for (found, expected) in parameters.iter().zip([0.9, 1.1, 1.0]) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
    }

    #[test]
    fn zero_codes_give_finite_values() {
        let net = Net::new(15, &mut ChaCha8Rng::seed_from_u64(1));
        let (loss, gradient) = net.loss_and_gradient(&[0.0; 2 * GENERIC_SIZE]);
        assert!(loss.is_finite() && gradient.iter().all(|g| g.is_finite()));
        let decoded = net.decode(&[0.0; 15]);
        assert!(decoded.iter().all(|value| value.is_finite()));
    }
}

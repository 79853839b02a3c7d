//! Reference, not for production: the terms of the loss and their gradients, in f64.

/// `weight * mean|value - target|` over the entries that have a target, and its gradient.
pub fn mean_absolute(weight: f64, values: &[f64], targets: &[Option<f64>]) -> (f64, Vec<f64>) {
    let valid = targets.iter().flatten().count().max(1) as f64;
    let mut loss = 0.0;
    let gradient = values.iter().zip(targets).map(|(value, target)| {
        let off = target.map_or(0.0, |target| value - target);
        loss += weight / valid * off.abs();
        weight / valid * sign(off)
    });
    let gradient = gradient.collect();
    (loss, gradient)
}

/// As [`mean_absolute`] of `exp(a) value + b`, the exposure being (a, b): loss, gradient with
/// respect to the values, gradient with respect to (a, b).
pub fn exposed(
    weight: f64,
    [a, b]: [f64; 2],
    values: &[f64],
    targets: &[Option<f64>],
) -> (f64, Vec<f64>, [f64; 2]) {
    let gain = a.exp();
    let shown: Vec<f64> = values.iter().map(|value| gain * value + b).collect();
    let (loss, d_shown) = mean_absolute(weight, &shown, targets);
    let d_a = d_shown.iter().zip(values).map(|(d, value)| d * gain * value).sum();
    let d_b = d_shown.iter().sum();
    (loss, d_shown.into_iter().map(|d| gain * d).collect(), [d_a, d_b])
}

/// `weight * mean|S - mean_axis(S)|` over all axes of all Gaussians, S = exp(log scale), and its
/// gradient with respect to the log scales.
pub fn isotropic(weight: f64, log_scales: &[[f64; 3]]) -> (f64, Vec<[f64; 3]>) {
    let share = weight / (3.0 * log_scales.len() as f64);
    let mut loss = 0.0;
    let gradient = log_scales.iter().map(|log_scale| {
        let s = log_scale.map(f64::exp);
        let mean = s.iter().sum::<f64>() / 3.0;
        loss += share * s.iter().map(|s| (s - mean).abs()).sum::<f64>();
        let common = s.iter().map(|s| sign(s - mean)).sum::<f64>() / 3.0;
        s.map(|s| share * (sign(s - mean) - common) * s)
    });
    let gradient = gradient.collect();
    (loss, gradient)
}

/// `weight * mean|S_f - sg(S_c)|` over all axes of all Gaussians, and its gradient with respect to
/// the language head's log scales.
pub fn tie(weight: f64, color: &[[f64; 3]], language: &[[f64; 3]]) -> (f64, Vec<[f64; 3]>) {
    let share = weight / (3.0 * color.len() as f64);
    let mut loss = 0.0;
    let gradient = color.iter().zip(language).map(|(color, language)| {
        std::array::from_fn(|axis| {
            let (c, f) = (color[axis].exp(), language[axis].exp());
            loss += share * (f - c).abs();
            share * sign(f - c) * f
        })
    });
    let gradient = gradient.collect();
    (loss, gradient)
}

/// Derivative of |x|, 0 at 0.
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

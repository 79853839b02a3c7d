//! Affine exposure: one picture's intensity as `exp(a)` times another's plus `b`.

/// Inverts an exposure: if `x = exp(a) y + b`, then `y = exp(a') x + b'`.
pub(super) fn inverse([a, b]: [f64; 2]) -> [f64; 2] {
    [-a, -b * (-a).exp()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_leads_back() {
        let [a, b] = [0.3, -0.05];
        let [c, d] = inverse([a, b]);
        let there = |y: f64| a.exp() * y + b;
        let back = |x: f64| c.exp() * x + d;
        assert!((back(there(0.4)) - 0.4).abs() < 1e-12);
        assert!((there(there(0.4)) - 0.4).abs() > 0.1, "and another exposure does not");
    }
}

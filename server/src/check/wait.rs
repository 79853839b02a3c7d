//! What a reader waits for before it gets an answer or a file.

use super::refusal::Refusal;
use crate::pipeline::map::Wait;
use std::time::Duration;

/// How long is waited if nothing else is said, seconds.
const USUAL_SECONDS: f64 = 30.0;
/// The longest wait, seconds.
const MOST_SECONDS: f64 = 600.0;

/// Checks the options `wait` ("settled", "converged", or empty), `min_sequence` and `wait_seconds`.
///
/// # Errors
/// [`Refusal`] names the option.
pub(crate) fn wait(
    wait: Option<&str>,
    min_sequence: Option<u64>,
    wait_seconds: Option<f64>,
) -> Result<Wait, Refusal> {
    let (settled, converged) = match wait.unwrap_or_default() {
        "" => (false, false),
        "settled" => (true, false),
        "converged" => (true, true),
        found => {
            let expected = format!("expected \"settled\" or \"converged\", found {found:?}");
            return Err(Refusal::new("wait", expected));
        }
    };
    let seconds = wait_seconds.unwrap_or(USUAL_SECONDS);
    if !(0.0..=MOST_SECONDS).contains(&seconds) {
        let expected = format!("expected 0 to {MOST_SECONDS}, found {seconds}");
        return Err(Refusal::new("wait_seconds", expected));
    }
    Ok(Wait { settled, converged, min_sequence, longest: Duration::from_secs_f64(seconds) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_checked() {
        let usual = Duration::from_secs(30);
        let nothing = Wait { longest: usual, ..Wait::default() };
        assert_eq!(wait(None, None, None).unwrap(), nothing);
        assert_eq!(wait(Some(""), None, None).unwrap(), nothing);
        let longest = Duration::from_millis(500);
        let all = Wait { settled: true, converged: false, min_sequence: Some(7), longest };
        assert_eq!(wait(Some("settled"), Some(7), Some(0.5)).unwrap(), all);
        let all = Wait { converged: true, ..all };
        assert_eq!(wait(Some("converged"), Some(7), Some(0.5)).unwrap(), all);
        let refused = |word, seconds| wait(word, None, seconds).unwrap_err().field;
        assert_eq!(refused(Some("done"), None), "wait");
        for seconds in [-1.0, 601.0, f64::NAN, f64::INFINITY] {
            assert_eq!(refused(None, Some(seconds)), "wait_seconds");
        }
    }
}

//! Processor time of a process of this machine, from `/proc`.

/// Ticks of `/proc/PID/stat` in a second. Linux reports them in this unit whatever the kernel's own
/// is, on every architecture that lexsplat is built for.
const TICKS_PER_SECOND: f64 = 100.0;

/// Seconds that all threads of a process have computed, in user and in kernel mode; nothing if there
/// is no such process.
pub(crate) fn processor_seconds(process: u32) -> Option<f64> {
    of_stat(&std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?)
}

/// The fields `utime` and `stime` of proc(5): the 12th and 13th after the name in parentheses.
fn of_stat(stat: &str) -> Option<f64> {
    // A name may have parentheses and spaces itself.
    let (_, fields) = stat.rsplit_once(')')?;
    let mut times = fields.split_whitespace().skip(11).map(str::parse::<u64>);
    let (user, system) = (times.next()?.ok()?, times.next()?.ok()?);
    Some((user + system) as f64 / TICKS_PER_SECOND)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, Instant};

    #[test]
    fn user_and_system_time_are_added_whatever_the_name_is() {
        let stat = "42 (a (b) c) S 1 42 42 0 -1 4194560 900 0 0 0 250 31 7 8 20 0 9 0 1 2 3";
        assert_eq!(of_stat(stat), Some(2.81));
        assert_eq!(of_stat("42 (short) S 1 2"), None);
        assert_eq!(of_stat(""), None);
    }

    #[test]
    fn a_process_that_computes_takes_time_and_one_that_is_not_there_has_none() {
        let own = std::process::id();
        let before = processor_seconds(own).expect("this process is there");
        let limit = Instant::now() + Duration::from_secs(60);
        while processor_seconds(own) <= Some(before) && Instant::now() < limit {
            std::hint::black_box((0..100_000_u64).sum::<u64>());
        }
        assert!(processor_seconds(own) > Some(before));
        assert_eq!(processor_seconds(u32::MAX), None);
    }
}

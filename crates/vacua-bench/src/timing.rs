//! Timing: medians of repeated runs.

use std::time::Instant;

/// The middle of some times; the mean of the two in the middle of an even number. 0 of none.
pub(crate) fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    match times.len() {
        0 => 0.0,
        n if n % 2 == 1 => times[n / 2],
        n => 0.5 * (times[n / 2 - 1] + times[n / 2]),
    }
}

/// Runs `work` and gives its result and the seconds it took.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

/// What something took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Took {
    /// Seconds that have passed.
    pub secs: f64,
    /// Seconds of all threads of this process together, which other processes hardly change; absent
    /// where the system does not count them.
    pub core_secs: Option<f64>,
}

/// As [`timed`], with the time of the process's threads.
pub(crate) fn clocked<T>(work: impl FnOnce() -> T) -> (T, Took) {
    let before = process_secs();
    let (result, secs) = timed(work);
    let core_secs = before.zip(process_secs()).map(|(from, to)| to - from);
    (result, Took { secs, core_secs })
}

/// Medians of several times.
pub(crate) fn medians(all: &[Took]) -> Took {
    let core_secs: Option<Vec<f64>> = all.iter().map(|took| took.core_secs).collect();
    Took {
        secs: median(all.iter().map(|took| took.secs).collect()),
        core_secs: core_secs.map(median),
    }
}

/// Seconds that the threads of this process have run.
fn process_secs() -> Option<f64> {
    #[cfg(unix)]
    {
        use rustix::time::{ClockId, clock_gettime};
        let time = clock_gettime(ClockId::ProcessCPUTime);
        Some(time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9)
    }
    #[cfg(not(unix))]
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_in_the_middle() {
        assert_eq!(median(vec![]), 0.0);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), 2.5);
    }

    #[cfg(unix)]
    #[test]
    fn threads_are_clocked() {
        let start = Instant::now();
        // The clock of a process may move in steps of hundredths of a second.
        let before = process_secs();
        let busy = || while process_secs() == before && start.elapsed().as_secs() < 30 {};
        let ((), took) = clocked(busy);
        assert!(took.secs > 0.0 && took.core_secs > Some(0.0), "{took:?}");
    }
}

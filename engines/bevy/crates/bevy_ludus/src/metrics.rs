//! Numbers that the game reports, until the trainer fetches them (PROTOCOL.md §8, "Metrics").

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

#[cfg(feature = "trainer")]
use serde_json::{Value, json};

const MAX_NAMES: usize = 64;
const MAX_NAME_CHARS: usize = 128;

/// Why a report cannot be taken.
#[derive(Clone, Debug, Error, PartialEq)]
pub(crate) enum MetricError {
    #[error("metric {name} is {value}, expected a finite number")]
    NotFinite { name: String, value: f64 },
    #[error("a metric's name has {0} characters, expected 1 to 128")]
    NameLength(usize),
    #[error("a metric's name is {0:?}, expected only printable characters, no space at either end")]
    Unprintable(String),
    #[error("metric {0} adds up to {1}, expected a finite number")]
    Overflow(String, f64),
    #[error("metric {0} is one more than the 64 that there may be")]
    TooMany(String),
}

/// The values of one metric.
#[derive(Clone, Copy, Debug)]
struct Summary {
    count: u64,
    sum: f64,
    min: f64,
    max: f64,
}

/// Metrics by name: those of one world, or of all worlds of the engine.
#[derive(Clone, Debug, Default)]
pub(crate) struct Summaries(BTreeMap<String, Summary>);

impl Summaries {
    fn add(&mut self, name: &str, new: Summary) -> Result<(), MetricError> {
        if let Some(own) = self.0.get_mut(name) {
            own.count += new.count;
            own.sum += new.sum;
            own.min = own.min.min(new.min);
            own.max = own.max.max(new.max);
            if !own.sum.is_finite() {
                return Err(MetricError::Overflow(name.to_owned(), own.sum));
            }
            return Ok(());
        }
        check_name(name)?;
        if self.0.len() == MAX_NAMES {
            return Err(MetricError::TooMany(name.to_owned()));
        }
        self.0.insert(name.to_owned(), new);
        Ok(())
    }

    /// Returns the request that carries them; none if nothing was reported.
    #[cfg(feature = "trainer")]
    pub fn into_request(self) -> Option<Value> {
        let metrics: serde_json::Map<_, _> = self
            .0
            .into_iter()
            .map(|(name, own)| {
                let value =
                    json!({"count": own.count, "sum": own.sum, "min": own.min, "max": own.max});
                (name, value)
            })
            .collect();
        (!metrics.is_empty()).then(|| json!({"kind": "metrics", "metrics": metrics}))
    }
}

fn check_name(name: &str) -> Result<(), MetricError> {
    let length = name.chars().count();
    if !(1..=MAX_NAME_CHARS).contains(&length) {
        return Err(MetricError::NameLength(length));
    }
    if name.trim() != name || !name.chars().all(is_printable) {
        return Err(MetricError::Unprintable(name.to_owned()));
    }
    Ok(())
}

/// Asks the table of Unicode categories that `Debug` has: of PROTOCOL.md §1, all but `U+0020` are
/// escaped there. Behind a letter, an accent is not.
fn is_printable(character: char) -> bool {
    let text = String::from_iter(['a', character]);
    matches!(character, '"' | '\'' | '\\') || text.escape_debug().eq(text.chars())
}

/// What one world has reported since the trainer fetched it last; none where nobody trains.
///
/// Apart from the world: with 16,384 worlds, each step would otherwise read twice the memory.
#[derive(Clone, Debug, Default)]
pub(crate) struct Metrics(Option<Box<Reports>>);

#[derive(Clone, Debug)]
struct Reports {
    summaries: Summaries,
    error: Option<MetricError>,
    /// Set for all worlds at once if a report of one is refused, so that a step looks at one
    /// place.
    is_refused: Arc<AtomicBool>,
}

impl Metrics {
    pub fn report(&mut self, name: &str, value: f64) {
        let Some(reports) = &mut self.0 else {
            return;
        };
        let added = if value.is_finite() {
            let (count, sum, min, max) = (1, value, value, value);
            let new = Summary {
                count,
                sum,
                min,
                max,
            };
            reports.summaries.add(name, new)
        } else {
            let name = name.to_owned();
            Err(MetricError::NotFinite { name, value })
        };
        if let Err(error) = added {
            reports.error.get_or_insert(error);
            reports.is_refused.store(true, Ordering::Relaxed);
        }
    }
}

/// The trainer's side.
#[cfg(feature = "trainer")]
impl Metrics {
    /// Takes reports from now on.
    pub fn open(&mut self, is_refused: &Arc<AtomicBool>) {
        self.0 = Some(Box::new(Reports {
            summaries: Summaries::default(),
            error: None,
            is_refused: Arc::clone(is_refused),
        }));
    }

    /// Moves what was reported to the sums of all worlds.
    pub fn take_into(&mut self, sums: &mut Summaries) -> Result<(), MetricError> {
        let Some(reports) = &mut self.0 else {
            return Ok(());
        };
        if let Some(error) = reports.error.take() {
            return Err(error);
        }
        std::mem::take(&mut reports.summaries)
            .0
            .iter()
            .try_for_each(|(name, own)| sums.add(name, *own))
    }
}

#[cfg(all(test, feature = "trainer"))]
mod tests {
    use super::*;

    fn opened() -> (Metrics, Arc<AtomicBool>) {
        let is_refused = Arc::default();
        let mut metrics = Metrics::default();
        metrics.open(&is_refused);
        (metrics, is_refused)
    }

    #[test]
    fn what_was_reported_is_the_golden_request() {
        let file = "tests/golden/result_requests_metrics.json";
        let golden: Value = serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap();
        let (mut one, is_refused) = opened();
        let (mut two, _) = opened();
        one.report("jumps", 2.0);
        one.report("jumps", 1.0);
        two.report("jumps", 4.0);
        two.report("jumps", 3.0);
        two.report("Höhe ✓", -0.5);
        let mut sums = Summaries::default();
        one.take_into(&mut sums).unwrap();
        two.take_into(&mut sums).unwrap();
        assert_eq!(
            sums.into_request().as_ref(),
            Some(&golden["content"]["value"][1])
        );
        let mut nothing = Summaries::default();
        one.take_into(&mut nothing).unwrap();
        assert_eq!(nothing.into_request(), None, "nothing is taken twice");
        assert!(!is_refused.load(Ordering::Relaxed));
    }

    #[test]
    fn names_have_printable_characters_only() {
        let long = "é".repeat(MAX_NAME_CHARS);
        for name in [
            "Höhe ✓",
            "e\u{301}",
            "\u{301}",
            "\"it's\\",
            "日本",
            long.as_str(),
        ] {
            assert_eq!(check_name(name), Ok(()), "{name}");
        }
        // Of the categories Cc, Cf, Co, Cn, Zs, Zl and Zp.
        let bad = "\0\t\n\u{7f}\u{85}\u{ad}\u{200b}\u{202e}\u{feff}\u{e000}\u{fffe}\u{378}\u{a0}\u{3000}\u{2028}\u{2029}";
        for character in bad.chars() {
            let name = format!("a{character}b");
            assert_eq!(check_name(&name), Err(MetricError::Unprintable(name)));
        }
        for name in [" a", "a ", " "] {
            assert_eq!(
                check_name(name),
                Err(MetricError::Unprintable(name.to_owned()))
            );
        }
    }

    #[test]
    fn a_sum_beyond_all_numbers_is_an_error() {
        let (mut metrics, is_refused) = opened();
        metrics.report("big", f64::MAX);
        metrics.report("big", f64::MAX);
        assert!(is_refused.load(Ordering::Relaxed));
        let error = metrics.take_into(&mut Summaries::default()).unwrap_err();
        assert_eq!(
            error,
            MetricError::Overflow("big".to_owned(), f64::INFINITY)
        );
    }

    #[test]
    fn nothing_is_kept_without_a_trainer() {
        let mut metrics = Metrics::default();
        metrics.report("jumps", f64::NAN);
        let mut sums = Summaries::default();
        metrics.take_into(&mut sums).unwrap();
        assert_eq!(sums.into_request(), None);
    }

    #[test]
    fn the_first_report_that_cannot_be_is_an_error() {
        for (name, value, expected) in [
            ("bad", f64::NAN, "metric bad is NaN, expected a finite"),
            ("bad", f64::INFINITY, "metric bad is inf, expected a finite"),
            ("", 1.0, "a metric's name has 0 characters, expected 1"),
            ("a\n", 1.0, "a metric's name is \"a\\n\", expected only pri"),
            ("a ", 1.0, "a metric's name is \"a \", expected only print"),
            (
                "\u{202e}a",
                1.0,
                "a metric's name is \"\\u{202e}a\", expect",
            ),
            ("name 64", 1.0, "metric name 64 is one more than the 64"),
        ] {
            let (mut metrics, is_refused) = opened();
            for number in 0..MAX_NAMES {
                metrics.report(&format!("name {number}"), 1.0);
            }
            assert!(!is_refused.load(Ordering::Relaxed));
            metrics.report(name, value);
            metrics.report("also bad", f64::NAN);
            assert!(is_refused.load(Ordering::Relaxed));
            let error = metrics.take_into(&mut Summaries::default()).unwrap_err();
            assert!(error.to_string().starts_with(expected), "{error}");
        }
    }
}

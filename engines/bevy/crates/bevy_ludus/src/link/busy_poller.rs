//! When to look for data without sleeping, and when to leave the core to others.

use std::time::{Duration, Instant};

/// Between one look and the next it takes so long only if the core was taken away meanwhile.
const AWAY: Duration = Duration::from_millis(1);
/// Lost looks within [`LOST_WITHIN`] that mean nothing: updates, or the system's own work.
const MAX_LOST: u32 = 5;
const LOST_WITHIN: Duration = Duration::from_millis(100);
/// How long nobody looks then; twice as long each time that the core is soon lost again.
const FIRST_RESPITE: Duration = Duration::from_millis(100);
const LONGEST_RESPITE: Duration = Duration::from_secs(1);

/// How looking for data went lately.
///
/// Where another process wants the core, perhaps the very one that is waited for, looking without
/// sleeping would cost milliseconds a message: each side looks in vain until the system takes the
/// core away from it. So who often finds nothing, or loses the core meanwhile, leaves it alone for a
/// while: a tenth of a second, or up to a second where that happens again and again.
#[derive(Debug, Default)]
pub(super) struct Looks {
    lost_since: Option<Instant>,
    num_lost: u32,
    respite: Duration,
    respite_until: Option<Instant>,
}

impl Looks {
    /// Returns whether the core is left to others now.
    pub fn is_respite(&self, now: Instant) -> bool {
        self.respite_until.is_some_and(|until| now < until)
    }

    /// Returns whether the core was taken away between two looks.
    pub fn was_away(before: Instant, now: Instant) -> bool {
        now - before > AWAY
    }

    /// Takes that looking found nothing, or lost the core meanwhile.
    pub fn note_lost(&mut self, now: Instant) {
        if self
            .lost_since
            .is_none_or(|since| now - since > LOST_WITHIN)
        {
            self.lost_since = Some(now);
            self.num_lost = 0;
        }
        self.num_lost += 1;
        if self.num_lost > MAX_LOST {
            let is_soon = self
                .respite_until
                .is_some_and(|until| now - until < LONGEST_RESPITE);
            let longer = if is_soon {
                2 * self.respite
            } else {
                Duration::ZERO
            };
            self.respite = longer.clamp(FIRST_RESPITE, LONGEST_RESPITE);
            self.respite_until = Some(now + self.respite);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLISECOND: Duration = Duration::from_millis(1);

    /// Loses so many looks, with a pause before each; returns when the last was over.
    fn lose(looks: &mut Looks, mut now: Instant, count: u32, pause: Duration) -> Instant {
        for _ in 0..count {
            now += pause;
            looks.note_lost(now);
        }
        now
    }

    /// Asserts that the respite that has begun takes so long; returns when it is over.
    fn end_of_respite(looks: &Looks, now: Instant, milliseconds: u32) -> Instant {
        let end = now + milliseconds * MILLISECOND;
        assert!(looks.is_respite(end - MILLISECOND));
        assert!(!looks.is_respite(end));
        end
    }

    #[test]
    fn six_lost_looks_at_once_are_followed_by_a_respite() {
        let mut looks = Looks::default();
        let now = lose(&mut looks, Instant::now(), 6, 15 * MILLISECOND);
        end_of_respite(&looks, now, 100);
    }

    #[test]
    fn a_respite_is_longer_where_the_core_is_soon_lost_again() {
        let mut looks = Looks::default();
        let mut now = Instant::now();
        for milliseconds in [100, 200, 400, 800, 1000, 1000] {
            now = lose(&mut looks, now, 6, 15 * MILLISECOND);
            now = end_of_respite(&looks, now, milliseconds);
        }
        now = lose(&mut looks, now + 1000 * MILLISECOND, 6, 15 * MILLISECOND);
        end_of_respite(&looks, now, 100);
    }

    #[test]
    fn five_at_once_are_nothing() {
        let mut looks = Looks::default();
        let now = lose(&mut looks, Instant::now(), 5, 15 * MILLISECOND);
        assert!(!looks.is_respite(now));
    }

    #[test]
    fn one_now_and_then_is_nothing() {
        let mut looks = Looks::default();
        let now = lose(&mut looks, Instant::now(), 20, 30 * MILLISECOND);
        assert!(!looks.is_respite(now));
    }

    #[test]
    fn the_core_was_away_where_a_millisecond_is_missing() {
        let now = Instant::now();
        assert!(!Looks::was_away(now, now + MILLISECOND));
        assert!(Looks::was_away(now, now + 2 * MILLISECOND));
    }
}

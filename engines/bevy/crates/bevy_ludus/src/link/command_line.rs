//! What the command line tells the plugin (PROTOCOL.md §10).

use super::user_token::user_token;
use super::{Address, LinkError};
use std::path::{Path, PathBuf};

/// Environment variable with the token of a game that a trainer has started.
pub(super) const TOKEN_VARIABLE: &str = "LUDUS_TOKEN";

/// Where the trainer is, and how it is known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CommandLine {
    /// Addresses to connect to, in order.
    pub connect_to: Vec<Address>,
    /// Address to listen at.
    pub listen_at: Option<Address>,
    /// Secret shared with the trainer; empty: the one of this user, on this machine.
    pub token: String,
    /// Process that must stay alive.
    pub parent_pid: Option<u32>,
    /// Whether the game is only asked what it is.
    pub about: bool,
    /// Folder of a parity test that the game is only asked to answer.
    pub parity: Option<PathBuf>,
    /// Policy files that play while no trainer is there, by name of the policy.
    pub policies: Vec<(String, PathBuf)>,
    /// Whether those policies draw their actions.
    pub sample_actions: bool,
    /// Whether a line is printed for every episode that ends.
    pub has_report: bool,
    /// Whether the game leaves out its window and, without a trainer, plays as fast as it can.
    pub is_headless: bool,
    /// Whether the game is played no faster than people watch it, even by a trainer.
    pub is_real_time: bool,
}

impl CommandLine {
    /// Reads arguments; those that are not for Ludus are ignored.
    ///
    /// # Errors
    /// An address is malformed, or the file with the token cannot be read.
    pub fn read(arguments: impl Iterator<Item = String>) -> Result<Self, LinkError> {
        let mut read = Self::default();
        for argument in arguments {
            let (name, value) = argument.split_once('=').unwrap_or((&argument, ""));
            match name {
                "--ludus-about" => read.about = true,
                "--ludus-connect" => read.connect_to = addresses(value)?,
                "--ludus-listen" => read.listen_at = Some(value.parse()?),
                "--ludus-token-file" => read.token = token(Path::new(value))?,
                "--ludus-parent" => read.parent_pid = value.parse().ok(),
                "--ludus-parity" => read.parity = Some(value.into()),
                "--ludus-policy" => read.policies.push(policy(value)),
                "--ludus-sample" => read.sample_actions = true,
                "--ludus-report" => read.has_report = true,
                "--ludus-headless" => read.is_headless = true,
                "--ludus-real-time" => read.is_real_time = true,
                _ => {}
            }
        }
        Ok(read)
    }

    /// Returns the token that a trainer at the other end has to know; empty if there is none.
    pub(super) fn token_for(&self, is_local: bool) -> Result<String, LinkError> {
        if self.token.is_empty() && is_local {
            return user_token();
        }
        Ok(self.token.clone())
    }

    /// Returns whether the game was started by or for a trainer.
    #[must_use]
    pub fn has_trainer(&self) -> bool {
        !self.connect_to.is_empty() || self.listen_at.is_some()
    }

    /// Returns whether the game should leave out its window.
    #[must_use]
    pub fn has_no_window(&self) -> bool {
        self.is_headless || (self.has_trainer() && !self.is_real_time)
    }

    /// Returns whether time passes as fast as the machine can.
    #[must_use]
    pub fn is_uncapped(&self) -> bool {
        (self.is_headless || self.has_trainer()) && !self.is_real_time
    }
}

/// Splits NAME=PATH; a name without a path is a file that will not be found.
fn policy(value: &str) -> (String, PathBuf) {
    let (name, path) = value.split_once('=').unwrap_or((value, ""));
    (name.to_owned(), path.into())
}

fn addresses(value: &str) -> Result<Vec<Address>, LinkError> {
    let parts = value.split(',').filter(|part| !part.is_empty());
    parts.map(|part| Ok(part.parse()?)).collect()
}

fn token(path: &Path) -> Result<String, LinkError> {
    let text = std::fs::read_to_string(path).map_err(|error| LinkError::TokenFile {
        path: path.to_owned(),
        reason: error.to_string(),
    })?;
    Ok(text.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(arguments: &[&str]) -> Result<CommandLine, LinkError> {
        CommandLine::read(arguments.iter().map(ToString::to_string))
    }

    #[test]
    fn arguments_of_others_are_passed_over() {
        let arguments = [
            "--headless",
            "--",
            "--ludus-connect=unix:/a,tcp:[::1]:7",
            "--x=y",
        ];
        let read = read(&arguments).unwrap();
        let names: Vec<_> = read.connect_to.iter().map(ToString::to_string).collect();
        assert_eq!(names, ["unix:/a", "tcp:[::1]:7"]);
        assert!(read.has_trainer());
    }

    #[test]
    fn policies_and_pace_are_read() {
        let arguments = [
            "--ludus-policy=hero=/a=b/hero.ludus.json",
            "--ludus-policy=cart",
        ];
        let alone = read(&arguments).unwrap();
        let path = |text: &str| PathBuf::from(text);
        let expected = [
            ("hero".to_owned(), path("/a=b/hero.ludus.json")),
            ("cart".to_owned(), path("")),
        ];
        assert_eq!(alone.policies, expected);
        assert!(!alone.has_no_window() && !alone.is_uncapped());
        let headless = read(&["--ludus-headless", "--ludus-sample", "--ludus-report"]).unwrap();
        assert!(headless.has_no_window() && headless.is_uncapped());
        assert!(headless.sample_actions && headless.has_report);
        let trained = ["--ludus-connect=unix:/a", "--ludus-real-time"];
        assert!(read(&trained[..1]).unwrap().has_no_window());
        let watched = read(&trained).unwrap();
        assert!(!watched.has_no_window() && !watched.is_uncapped());
    }

    #[test]
    fn mistakes_are_told() {
        assert!(!read(&["--verbose"]).unwrap().has_trainer());
        let error = read(&["--ludus-listen=nowhere"]).unwrap_err();
        assert!(error.to_string().contains("tcp:HOST:PORT"), "{error}");
        let error = read(&["--ludus-token-file=/no/such/file"]).unwrap_err();
        assert!(error.to_string().contains("/no/such/file"), "{error}");
    }
}

//! Addresses: `tcp:HOST:PORT` and `unix:PATH` (PROTOCOL.md §10).

use std::fmt;
use std::net::IpAddr;
use std::path::PathBuf;
use std::str::FromStr;
use thiserror::Error;

/// Where a trainer or a game is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// A host, by name or number, and a port.
    Tcp {
        /// The host, without brackets.
        host: String,
        /// The port.
        port: u16,
    },
    /// A Unix stream socket.
    Unix(PathBuf),
}

/// A text that is not an address.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("\"{0}\" is not an address; expected tcp:HOST:PORT or unix:PATH")]
pub struct AddressError(pub String);

impl Address {
    /// Returns whether the address can only be reached from this machine.
    #[must_use]
    pub fn is_local(&self) -> bool {
        match self {
            Self::Unix(_) => true,
            Self::Tcp { host, .. } => {
                let number = host.parse::<IpAddr>();
                host == "localhost" || number.is_ok_and(|number| number.is_loopback())
            }
        }
    }
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let error = || AddressError(text.to_owned());
        if let Some(path) = text.strip_prefix("unix:") {
            return if path.is_empty() {
                Err(error())
            } else {
                Ok(Self::Unix(path.into()))
            };
        }
        let rest = text.strip_prefix("tcp:").unwrap_or(text);
        let (host, port) = rest.rsplit_once(':').ok_or_else(error)?;
        let host = host.trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() {
            return Err(error());
        }
        Ok(Self::Tcp {
            host: host.to_owned(),
            port: port.parse().map_err(|_| error())?,
        })
    }
}

impl fmt::Display for Address {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unix(path) => write!(formatter, "unix:{}", path.display()),
            Self::Tcp { host, port } if host.contains(':') => {
                write!(formatter, "tcp:[{host}]:{port}")
            }
            Self::Tcp { host, port } => write!(formatter, "tcp:{host}:{port}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_written() {
        for text in [
            "tcp:127.0.0.1:11011",
            "tcp:[::1]:80",
            "tcp:example.org:1",
            "unix:/tmp/a:b",
        ] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
        for text in [
            "",
            "tcp:",
            "tcp:host",
            "tcp::80",
            "tcp:host:port",
            "tcp:host:70000",
            "unix:",
        ] {
            assert_eq!(text.parse::<Address>(), Err(AddressError(text.to_owned())));
        }
    }

    #[test]
    fn only_this_machine_is_local() {
        for (text, is_local) in [
            ("tcp:127.0.0.1:1", true),
            ("tcp:127.9.9.9:1", true),
            ("tcp:[::1]:1", true),
            ("tcp:localhost:1", true),
            ("unix:/tmp/a", true),
            ("tcp:0.0.0.0:1", false),
            ("tcp:127.0.0.1.example.org:1", false),
            ("tcp:192.168.0.1:1", false),
        ] {
            assert_eq!(
                text.parse::<Address>().unwrap().is_local(),
                is_local,
                "{text}"
            );
        }
    }
}

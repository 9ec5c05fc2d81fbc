//! Which requests reach the game: those of programs on this machine, not those of web pages.
//!
//! A page that somebody has open in a browser may send requests to 127.0.0.1, too, by a picture, a
//! link or a script. Browsers mark them: `Origin` and `Sec-Fetch-Site` say what page they come from
//! (Fetch Standard, "Sec-Fetch-Site"). A name of the page's own that leads here (DNS rebinding) is
//! what `Host` shows. Programs such as `requests` and `curl` send neither of the first two.

use super::error::Refusal;
use hyper::header::{HOST, HeaderMap, HeaderName, ORIGIN};
use hyper::http::uri::Authority;
use std::net::IpAddr;

const SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// Checks where a request comes from, by its headers.
///
/// # Errors
/// A web page has sent it, or it is for another machine.
pub(super) fn check_sender(headers: &HeaderMap) -> Result<(), Refusal> {
    let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or(""));
    let host = text(HOST).unwrap_or("");
    if !is_loopback(host) {
        return Err(Refusal::forbidden(format!(
            "the header Host is \"{host}\"\nhint: ask for http://127.0.0.1 or http://localhost"
        )));
    }
    if text(ORIGIN).is_some_and(|origin| origin.strip_prefix("http://") != Some(host)) {
        return Err(Refusal::forbidden("web pages may not play this game"));
    }
    match text(SEC_FETCH_SITE) {
        None | Some("same-origin" | "none") => Ok(()),
        Some(_) => Err(Refusal::forbidden("web pages may not play this game")),
    }
}

/// Returns whether a `Host` names this machine, by a name that leads nowhere else.
fn is_loopback(host: &str) -> bool {
    let Ok(authority) = host.parse::<Authority>() else {
        return false;
    };
    let name = authority.host();
    let number = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost")
        || number
            .parse::<IpAddr>()
            .is_ok_and(|number| number.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyper::header::HeaderValue;

    fn status_of(headers: &[(&'static str, &'static str)]) -> u16 {
        let headers: HeaderMap = headers
            .iter()
            .map(|(name, value)| {
                (
                    HeaderName::from_static(name),
                    HeaderValue::from_static(value),
                )
            })
            .collect();
        check_sender(&headers).map_or_else(|refusal| refusal.status.as_u16(), |()| 200)
    }

    #[test]
    fn only_names_of_this_machine_are_hosts() {
        for host in [
            "127.0.0.1:7878",
            "127.9.9.9",
            "localhost:1",
            "LocalHost",
            "[::1]:80",
        ] {
            assert_eq!(status_of(&[("host", host)]), 200, "{host}");
        }
        for host in [
            "",
            "example.org",
            "127.0.0.1.evil.example",
            "localhost.evil.example",
            "evil.example:7878",
            "192.168.0.1",
            "0.0.0.0",
            "user@evil.example",
        ] {
            assert_eq!(status_of(&[("host", host)]), 403, "{host}");
        }
        assert_eq!(status_of(&[]), 403);
    }

    #[test]
    fn pages_are_told_by_their_origin_and_by_where_they_were_fetched_from() {
        let host = ("host", "127.0.0.1:7878");
        assert_eq!(status_of(&[host, ("origin", "http://127.0.0.1:7878")]), 200);
        for origin in [
            "http://evil.example",
            "http://127.0.0.1:80",
            "https://127.0.0.1:7878",
            "null",
        ] {
            assert_eq!(status_of(&[host, ("origin", origin)]), 403, "{origin}");
        }
        for site in ["same-origin", "none"] {
            assert_eq!(status_of(&[host, ("sec-fetch-site", site)]), 200, "{site}");
        }
        for site in ["cross-site", "same-site", ""] {
            assert_eq!(status_of(&[host, ("sec-fetch-site", site)]), 403, "{site}");
        }
    }
}

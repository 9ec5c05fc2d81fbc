//! A small HTTP client that can also misbehave.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

/// No test waits longer for an answer.
const DEADLINE: Duration = Duration::from_secs(20);

/// A connection that stays open.
pub struct Client {
    pub stream: BufReader<TcpStream>,
}

#[derive(Debug, PartialEq, Eq)]
pub struct Response {
    pub status: u16,
    pub head: String,
    pub body: String,
}

impl Client {
    pub fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        stream.set_write_timeout(Some(DEADLINE)).unwrap();
        stream.set_nodelay(true).unwrap();
        Self {
            stream: BufReader::new(stream),
        }
    }

    pub fn send(&mut self, verb: &str, path: &str, body: &str) {
        let length = body.len();
        let head = format!(
            "{verb} {path} HTTP/1.1\r\nhost: localhost\r\ncontent-length: {length}\r\n\r\n"
        );
        // A server may refuse before it has read everything.
        let _ = self
            .stream
            .get_mut()
            .write_all(format!("{head}{body}").as_bytes());
    }

    pub fn receive(&mut self) -> Response {
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") {
            let num_read = self.stream.read_line(&mut head).unwrap();
            assert!(num_read > 0, "the connection was closed after {head:?}");
        }
        let length = header(&head, "content-length").unwrap().parse().unwrap();
        let mut body = vec![0; length];
        self.stream.read_exact(&mut body).unwrap();
        Response {
            status: head[9..12].parse().unwrap(),
            body: String::from_utf8(body).unwrap(),
            head,
        }
    }

    pub fn ask(&mut self, verb: &str, path: &str, body: &str) -> Response {
        self.send(verb, path, body);
        self.receive()
    }

    /// Returns the body of an answer that must be good.
    pub fn get(&mut self, path: &str) -> String {
        let response = self.ask("GET", path, "");
        assert_eq!(response.status, 200, "{path}: {}", response.body);
        response.body
    }

    /// Sends one action text per agent, and returns the body of the answer.
    pub fn step(&mut self, actions: &[&str]) -> String {
        self.get(&step_path(actions))
    }
}

/// Returns a value of the head.
pub fn header(head: &str, name: &str) -> Option<String> {
    head.lines().find_map(|line| {
        let (found, value) = line.split_once(':')?;
        found
            .eq_ignore_ascii_case(name)
            .then(|| value.trim().to_owned())
    })
}

/// Returns the path of a step with one action text per agent.
pub fn step_path(actions: &[&str]) -> String {
    let entries: Vec<_> = actions
        .iter()
        .map(|text| serde_json::json!({ "action": text }))
        .collect();
    let payload = serde_json::to_string(&entries).unwrap();
    let query: String = form_urlencoded::Serializer::new(String::new())
        .append_pair("payload", &payload)
        .finish();
    format!("/step?{query}")
}

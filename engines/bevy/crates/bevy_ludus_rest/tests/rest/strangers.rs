//! Web pages, and clients that send half of a request.

use crate::client::{Client, Response, step_path};
use crate::game::{Game, Habits, settings};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Sends a request with headers of the caller's.
fn ask(game: &Game, path: &str, headers: &str) -> Response {
    let mut client = game.client();
    let request = format!("GET {path} HTTP/1.1\r\n{headers}\r\n");
    client
        .stream
        .get_mut()
        .write_all(request.as_bytes())
        .unwrap();
    client.receive()
}

fn num_steps(game: &Game) -> String {
    let state = game.client().get("/state");
    let state: serde_json::Value = serde_json::from_str(&state).unwrap();
    state["num_steps"].to_string()
}

#[test]
fn requests_of_web_pages_never_reach_the_game() {
    let game = Game::start(settings(), Habits::default());
    let own = format!("Host: {}\r\n", game.address);
    game.client().step(&["1", "1"]);
    // What Chromium sends for a script, a picture, a form and a link of another page, and after a
    // name of that page was pointed at this machine.
    let pages = [
        format!("{own}Origin: http://evil.example\r\nSec-Fetch-Site: cross-site\r\n"),
        format!("{own}Sec-Fetch-Site: cross-site\r\nSec-Fetch-Dest: image\r\n"),
        format!("{own}Origin: null\r\nSec-Fetch-Site: cross-site\r\n"),
        format!("{own}Sec-Fetch-Site: same-site\r\nSec-Fetch-Mode: navigate\r\n"),
        "Host: evil.example:7878\r\nSec-Fetch-Site: same-origin\r\n".to_owned(),
        "Host: 127.0.0.1.evil.example\r\n".to_owned(),
        String::new(),
    ];
    for headers in &pages {
        for path in [step_path(&["1", "1"]).as_str(), "/reset", "/state"] {
            assert_eq!(ask(&game, path, headers).status, 403, "{path} {headers}");
        }
    }
    assert_eq!(num_steps(&game), "1");
}

#[test]
fn programs_and_people_at_the_address_line_are_accepted() {
    let game = Game::start(settings(), Habits::default());
    let port = game.address.port();
    for headers in [
        format!("Host: 127.0.0.1:{port}\r\nUser-Agent: python-requests/2.31.0\r\n"),
        format!("host: localhost:{port}\r\naccept: */*\r\n"),
        format!("Host: 127.0.0.1:{port}\r\nSec-Fetch-Site: none\r\n"),
        format!("Host: [::1]:{port}\r\n"),
    ] {
        let response = ask(&game, &step_path(&["1", "1"]), &headers);
        assert_eq!(response.status, 200, "{headers} {}", response.body);
    }
    assert_eq!(num_steps(&game), "4");
}

/// Opens connections that send the beginning of a request, or nothing.
fn open_half(game: &Game, count: usize, beginning: &str) -> Vec<TcpStream> {
    let open = |_| {
        let mut stream = TcpStream::connect(game.address).unwrap();
        stream.write_all(beginning.as_bytes()).unwrap();
        stream
    };
    (0..count).map(open).collect()
}

#[test]
fn half_sent_requests_keep_no_client_out() {
    let game = Game::start(settings(), Habits::default());
    let mut regular = game.client();
    regular.step(&["1", "1"]);
    let body = "POST /step HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n[";
    for beginning in ["GET /step?payload=", body, ""] {
        let half = open_half(&game, 64, beginning);
        let began = Instant::now();
        game.client().step(&["1", "1"]);
        // A client that has played keeps its place.
        regular.step(&["1", "1"]);
        assert!(began.elapsed() < Duration::from_secs(5), "{beginning:?}");
        drop(half);
    }
    assert_eq!(num_steps(&game), "7");
}

#[test]
fn a_request_must_arrive_in_time_and_a_client_may_be_silent_between_two() {
    let game = Game::start(settings(), Habits::default());
    let mut silent = game.client();
    silent.step(&["1", "1"]);
    let mut head = open_half(&game, 1, "GET /state HTTP/1.1\r\nHost: loc");
    let body = "POST /step HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n[";
    let mut body = Client {
        stream: std::io::BufReader::new(open_half(&game, 1, body).remove(0)),
    };
    let limit = Some(Duration::from_secs(20));
    head[0].set_read_timeout(limit).unwrap();
    body.stream.get_mut().set_read_timeout(limit).unwrap();
    assert_eq!(head[0].read(&mut [0; 64]).unwrap(), 0, "it was closed");
    assert_eq!(body.receive().status, 408);
    silent.step(&["1", "1"]);
}

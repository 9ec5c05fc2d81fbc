//! The four endpoints.

use super::connections::{Connection, REQUEST_TIMEOUT};
use super::error::Refusal;
use super::game_handle::GameHandle;
use super::guard::check_sender;
use super::payload::{StepQuery, read_actions};
use super::queue::Ask;
use http_body_util::{BodyExt, Full, LengthLimitError, Limited};
use hyper::body::{Body, Bytes};
use hyper::header::{ALLOW, CONTENT_TYPE, HeaderValue, SERVER};
use hyper::{Method, Request, Response, StatusCode};
use std::convert::Infallible;
use std::error::Error;
use tokio::time::timeout_at;

/// The longest body of a request, bytes.
const MAX_BODY: usize = 16 << 20;
const TEXT: &str = "text/plain";
const PRODUCT: &str = concat!("bevy_ludus/", env!("CARGO_PKG_VERSION"));

/// Answers one request; mistakes become a status and a reason.
pub(super) async fn answer<B>(
    game: &GameHandle,
    connection: &Connection,
    request: Request<B>,
) -> Result<Response<Full<Bytes>>, Infallible>
where
    B: Body<Error: Into<Box<dyn Error + Send + Sync>>>,
{
    let _open = game.open();
    let allowed = verbs(request.uri().path());
    let answered = if let Err(refusal) = check_sender(request.headers()) {
        Err(refusal)
    } else if allowed.is_empty() {
        Err(unknown(request.uri().path()))
    } else if allowed.contains(request.method()) {
        route(game, connection, request).await
    } else {
        Ok(wrong_verb(allowed))
    };
    let mut response = answered.unwrap_or_else(|refusal| {
        let mut response = text(refusal.reason);
        *response.status_mut() = refusal.status;
        response
    });
    response
        .headers_mut()
        .insert(SERVER, HeaderValue::from_static(PRODUCT));
    connection.note_answer();
    Ok(response)
}

/// Returns with which verbs a path may be asked for; with none if there is no such path.
fn verbs(path: &str) -> &'static [Method] {
    match path {
        "/state" | "/visual_observations" => &[Method::GET],
        "/reset" | "/step" => &[Method::GET, Method::POST],
        _ => &[],
    }
}

async fn route<B>(
    game: &GameHandle,
    connection: &Connection,
    request: Request<B>,
) -> Result<Response<Full<Bytes>>, Refusal>
where
    B: Body<Error: Into<Box<dyn Error + Send + Sync>>>,
{
    let (head, body) = request.into_parts();
    let path = head.uri.path();
    let mut query = StepQuery::read(head.uri.query().unwrap_or_default());
    if path == "/step" && query.payload.is_none() && head.method == Method::POST {
        query.payload = Some(read_body(body, connection).await?);
    }
    connection.note_request();
    match path {
        "/state" => game.export.state().map(text),
        "/reset" => reset(game).await.map(text),
        "/step" => step(game, query).await.map(text),
        _ => picture(game).await,
    }
}

#[cfg(feature = "camera")]
async fn picture(game: &GameHandle) -> Result<Response<Full<Bytes>>, Refusal> {
    let pictures = game.pictures.as_ref().ok_or_else(no_pixels)?;
    let _turn = game.play(Ask::Picture).await?;
    let mut response = Response::new(Full::new(Bytes::from(pictures.png()?)));
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static("image/png"));
    Ok(response)
}

#[cfg(not(feature = "camera"))]
async fn picture(_: &GameHandle) -> Result<Response<Full<Bytes>>, Refusal> {
    Err(no_pixels())
}

async fn reset(game: &GameHandle) -> Result<String, Refusal> {
    let _turn = game.play(Ask::Reset).await?;
    game.export.agents()
}

async fn step(game: &GameHandle, query: StepQuery) -> Result<String, Refusal> {
    let payload = query.payload.ok_or_else(|| {
        Refusal::bad_request(
            "the payload is missing\nhint: /step?payload=[{\"action\": \"…\"}, …], URL-encoded",
        )
    })?;
    let actions = read_actions(&payload, game.num_agents)?;
    let _turn = game.play(Ask::Step(actions)).await?;
    let agents = game.export.agents()?;
    if query.is_state_included {
        let state = game.export.state()?;
        return Ok(format!(r#"{{"agents":{agents},"state":{state}}}"#));
    }
    Ok(agents)
}

async fn read_body<B>(body: B, connection: &Connection) -> Result<Vec<u8>, Refusal>
where
    B: Body<Error: Into<Box<dyn Error + Send + Sync>>>,
{
    let read = Limited::new(body, MAX_BODY).collect();
    let Ok(body) = timeout_at(connection.deadline(), read).await else {
        let seconds = REQUEST_TIMEOUT.as_secs();
        let reason = format!("the payload did not arrive within {seconds} s");
        return Err(Refusal::new(StatusCode::REQUEST_TIMEOUT, reason));
    };
    body.map(|body| body.to_bytes().into()).map_err(|error| {
        if error.is::<LengthLimitError>() {
            let reason = format!("the payload is longer than {MAX_BODY} bytes");
            return Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, reason);
        }
        Refusal::bad_request(format!("the payload did not arrive: {error}"))
    })
}

fn text(text: String) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::new(Bytes::from(text)));
    response
        .headers_mut()
        .insert(CONTENT_TYPE, HeaderValue::from_static(TEXT));
    response
}

fn unknown(path: &str) -> Refusal {
    Refusal::new(
        StatusCode::NOT_FOUND,
        format!("there is no {path}\nhint: /state, /step, /reset and /visual_observations"),
    )
}

fn wrong_verb(allowed: &[Method]) -> Response<Full<Bytes>> {
    let names: Vec<_> = allowed.iter().map(Method::as_str).collect();
    let names = names.join(", ");
    let mut response = text(format!("the verb must be one of: {names}"));
    *response.status_mut() = StatusCode::METHOD_NOT_ALLOWED;
    if let Ok(value) = HeaderValue::from_str(&names) {
        response.headers_mut().insert(ALLOW, value);
    }
    response
}

fn no_pixels() -> Refusal {
    Refusal::new(
        StatusCode::NOT_IMPLEMENTED,
        "this game shows no pixels\nhint: it needs a renderer (RenderingPlugins of bevy_ludus, or \
         DefaultPlugins of bevy), the feature `camera` of bevy_ludus_rest, and \
         AIGymSettings { render_to_buffer: true, .. }",
    )
}

//! The four endpoints.

use super::desk::Ask;
use super::error::Refusal;
use super::front::Front;
use super::payload::{StepQuery, read_actions};
use http_body_util::{BodyExt, Full, LengthLimitError, Limited};
use hyper::body::{Body, Bytes};
use hyper::header::{ALLOW, CONTENT_TYPE, HeaderValue, SERVER};
use hyper::{Method, Request, Response, StatusCode};
use std::convert::Infallible;
use std::error::Error;

/// The longest body of a request, bytes.
const MAX_BODY: usize = 16 << 20;
const TEXT: &str = "text/plain";
const PRODUCT: &str = concat!("bevy_ludus/", env!("CARGO_PKG_VERSION"));

/// Answers one request; mistakes become a status and a reason.
pub(super) async fn answer<B>(
    front: &Front,
    request: Request<B>,
) -> Result<Response<Full<Bytes>>, Infallible>
where
    B: Body<Error: Into<Box<dyn Error + Send + Sync>>>,
{
    let _open = front.open();
    let allowed = verbs(request.uri().path());
    let answered = if allowed.is_empty() {
        Err(unknown(request.uri().path()))
    } else if allowed.contains(request.method()) {
        route(front, request).await
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

async fn route<B>(front: &Front, request: Request<B>) -> Result<Response<Full<Bytes>>, Refusal>
where
    B: Body<Error: Into<Box<dyn Error + Send + Sync>>>,
{
    match request.uri().path() {
        "/state" => front.export.state().map(text),
        "/reset" => reset(front).await.map(text),
        "/step" => step(front, request).await.map(text),
        _ => picture(front).await,
    }
}

#[cfg(feature = "camera")]
async fn picture(front: &Front) -> Result<Response<Full<Bytes>>, Refusal> {
    let pictures = front.pictures.as_ref().ok_or_else(no_pixels)?;
    let _turn = front.play(Ask::Picture).await?;
    let mut response = Response::new(Full::new(Bytes::from(pictures.png()?)));
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static("image/png"));
    Ok(response)
}

#[cfg(not(feature = "camera"))]
async fn picture(_: &Front) -> Result<Response<Full<Bytes>>, Refusal> {
    Err(no_pixels())
}

async fn reset(front: &Front) -> Result<String, Refusal> {
    let _turn = front.play(Ask::Reset).await?;
    front.export.agents()
}

async fn step<B>(front: &Front, request: Request<B>) -> Result<String, Refusal>
where
    B: Body<Error: Into<Box<dyn Error + Send + Sync>>>,
{
    let query = StepQuery::read(request.uri().query().unwrap_or_default());
    let actions = match (&query.payload, request.method()) {
        (Some(payload), _) => read_actions(payload.as_bytes(), front.num_agents),
        (None, &Method::POST) => read_actions(&read_body(request).await?, front.num_agents),
        (None, _) => Err(Refusal::bad_request(
            "the payload is missing\nhint: /step?payload=[{\"action\": \"…\"}, …], URL-encoded",
        )),
    }?;
    let _turn = front.play(Ask::Step(actions)).await?;
    let agents = front.export.agents()?;
    if query.is_state_included {
        let state = front.export.state()?;
        return Ok(format!(r#"{{"agents":{agents},"state":{state}}}"#));
    }
    Ok(agents)
}

async fn read_body<B>(request: Request<B>) -> Result<Bytes, Refusal>
where
    B: Body<Error: Into<Box<dyn Error + Send + Sync>>>,
{
    let body = Limited::new(request.into_body(), MAX_BODY).collect().await;
    body.map(http_body_util::Collected::to_bytes)
        .map_err(|error| {
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
         DefaultPlugins of bevy), the feature `camera` of bevy_ludus, and \
         AIGymSettings { render_to_buffer: true, .. }",
    )
}

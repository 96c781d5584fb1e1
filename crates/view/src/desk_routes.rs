//! Requests of the page that labels and corrects.

use std::sync::Arc;

use axum::{
    Router,
    extract::{Path, Request, State},
    http::{HeaderMap, HeaderValue, StatusCode, header},
    middleware::from_fn_with_state,
    response::Response,
    routing::get,
};
use strandflow_core::Mask;

use crate::{
    Desk, Refusal, Token,
    desk::{Document, MaskFound, MaskKind},
    encode,
    http::{BINARY, Gate, JSON, answer, file, guarded, in_background, refusal, to_json, told},
    page::ANNOTATE,
    pictures::encoded,
    selection::{Query, number_in_path},
    upload,
};

const COMMAND: &str = "strandflow annotate";

type Served = State<Arc<dyn Desk>>;
type Named<const N: usize> = Path<[String; N]>;

/// All routes behind the guard.
pub(crate) fn router(desk: Box<dyn Desk>, token: Token) -> Router {
    let desk: Arc<dyn Desk> = desk.into();
    let log = desk.clone();
    let refused = Some(Arc::new(move |request: &str, status, why: &str| log.refused(request, status, why)) as _);
    let gate = Arc::new(Gate { token, command: COMMAND, refused });
    let api = Router::new()
        .route("/work", get(work))
        .route("/image/{view}/{frame}", get(image))
        .route("/labels", get(labels).put(put_labels))
        .route("/tracks/{frame}", get(tracks))
        .route("/mask/{kind}/{view}/{frame}", get(mask).put(put_mask).delete(delete_mask))
        .route("/sketches/{frame}", get(sketches).put(put_sketches));
    let missing = async || told(StatusCode::NOT_FOUND, "there is no such address", "docs/annotate.md has the protocol");
    Router::new()
        .route("/", get(async || file(ANNOTATE.index)))
        .route("/app.js", get(async || file(ANNOTATE.script)))
        .route("/app.css", get(async || file(ANNOTATE.style)))
        .route("/favicon.ico", get(async || answer(StatusCode::NO_CONTENT, "image/x-icon", Vec::new())))
        .nest("/api", api)
        .fallback(missing)
        .method_not_allowed_fallback(async || {
            told(StatusCode::METHOD_NOT_ALLOWED, "this cannot be done here", "docs/annotate.md has the protocol")
        })
        .layer(from_fn_with_state(gate, guarded))
        .with_state(desk)
}

/// Answers on a thread of its own.
async fn reply<T: Send + 'static>(
    desk: Arc<dyn Desk>,
    job: impl FnOnce(&dyn Desk) -> Result<T, Refusal> + Send + 'static,
    form: impl FnOnce(T) -> Response,
) -> Response {
    match in_background(COMMAND, move || job(&*desk)).await {
        Ok(found) => form(found),
        Err(response) => response,
    }
}

fn json(bytes: Vec<u8>) -> Response {
    answer(StatusCode::OK, JSON, bytes)
}

/// With the version that whoever changes it has to state.
fn versioned(mut response: Response, version: &str) -> Response {
    if let Ok(tag) = HeaderValue::from_str(&format!("\"{version}\"")) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}

fn document(document: Document) -> Response {
    versioned(json(document.json), &document.version)
}

/// What was written, by its new version.
fn written(version: String) -> Response {
    versioned(answer(StatusCode::NO_CONTENT, JSON, Vec::new()), &version)
}

/// The version that a change was made from.
fn made_from(headers: &HeaderMap) -> Result<String, Refusal> {
    let tag = headers.get(header::IF_MATCH).and_then(|tag| tag.to_str().ok());
    let version = tag.and_then(|tag| tag.strip_prefix('"')?.strip_suffix('"'));
    version.map(str::to_owned).ok_or_else(|| {
        let hint = "send `If-Match` with the `ETag` of what was changed";
        Refusal::bad("the request does not say which version it changes", hint)
    })
}

/// The version and the body of a change.
async fn change(request: Request, most: usize) -> Result<(String, Vec<u8>), Refusal> {
    let (parts, body) = request.into_parts();
    let version = made_from(&parts.headers)?;
    Ok((version, upload::body(&parts.headers, body, most).await?))
}

async fn work(State(desk): Served) -> Response {
    reply(desk, |desk| to_json(&desk.work()?), json).await
}

async fn image(State(desk): Served, Path([view, frame]): Named<2>, request: Request) -> Response {
    let query = request.uri().query().map(str::to_owned);
    let job = move |desk: &dyn Desk| {
        let mut query = Query::new(query.as_deref());
        let width = query.number("width", 16..=65_535)?;
        query.finish()?;
        encoded(&desk.image(&view, number_in_path("frame", &frame)?)?, width)
    };
    reply(desk, job, |(kind, bytes)| answer(StatusCode::OK, kind, bytes)).await
}

async fn labels(State(desk): Served) -> Response {
    reply(desk, |desk| desk.labels(), document).await
}

async fn put_labels(State(desk): Served, request: Request) -> Response {
    match change(request, upload::MOST_JSON).await {
        Ok((version, body)) => reply(desk, move |desk| desk.put_labels(&version, &body), written).await,
        Err(error) => refusal(&error),
    }
}

async fn tracks(State(desk): Served, Path(frame): Path<String>) -> Response {
    reply(desk, move |desk| to_json(&desk.tracks(number_in_path("frame", &frame)?)?), json).await
}

async fn sketches(State(desk): Served, Path(frame): Path<String>) -> Response {
    reply(desk, move |desk| desk.sketches(number_in_path("frame", &frame)?), document).await
}

async fn put_sketches(State(desk): Served, Path(frame): Path<String>, request: Request) -> Response {
    match change(request, upload::MOST_JSON).await {
        Ok((version, body)) => {
            let job = move |desk: &dyn Desk| desk.put_sketches(number_in_path("frame", &frame)?, &version, &body);
            reply(desk, job, written).await
        }
        Err(error) => refusal(&error),
    }
}

fn kind(name: &str) -> Result<MaskKind, Refusal> {
    match name {
        "hair" => Ok(MaskKind::Hair),
        "subject" => Ok(MaskKind::Subject),
        _ => Err(Refusal::missing(format!("there are no masks of `{name}`"), "ask for hair or subject")),
    }
}

async fn mask(State(desk): Served, Path([of, view, frame]): Named<3>) -> Response {
    let job = move |desk: &dyn Desk| desk.mask(kind(&of)?, &view, number_in_path("frame", &frame)?);
    let form = |MaskFound { version, origin, mask }| {
        versioned(answer(StatusCode::OK, BINARY, encode::mask(&mask, origin as u32)), &version)
    };
    reply(desk, job, form).await
}

async fn put_mask(State(desk): Served, Path([of, view, frame]): Named<3>, request: Request) -> Response {
    // The size is known before the body is read: a view of 640×480 needs no megabytes.
    let size = match desk.size(&view) {
        Ok(size) => size,
        Err(error) => return refusal(&error),
    };
    match change(request, upload::most_png(size)).await {
        Ok((version, png)) => {
            let job = move |desk: &dyn Desk| {
                let mask: Mask = upload::mask_from_png(&png, size)?;
                desk.put_mask(kind(&of)?, &view, number_in_path("frame", &frame)?, &version, Some(&mask))
            };
            reply(desk, job, written).await
        }
        Err(error) => refusal(&error),
    }
}

async fn delete_mask(State(desk): Served, Path([of, view, frame]): Named<3>, headers: HeaderMap) -> Response {
    let job = move |desk: &dyn Desk| {
        desk.put_mask(kind(&of)?, &view, number_in_path("frame", &frame)?, &made_from(&headers)?, None)
    };
    reply(desk, job, written).await
}

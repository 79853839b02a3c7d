//! `POST /v1/maps/{name}/query`: answering questions.

use super::error::Problem;
use super::extract::{Asker, Body, NamedMap, Options};
use super::reading::WaitOptions;
use super::state::State;
use super::to_json;
use crate::check::Question;
use crate::query_id::query_id;
use crate::telemetry::QUERY_SECONDS;
use axum::Json;
use lexsplat_proto::json;
use std::time::Instant;

/// Asks a map in plain words.
#[utoipa::path(
    post, path = "/v1/maps/{name}/query", operation_id = "query_map", tag = "query",
    params(("name" = String, Path, description = "name of the map"), WaitOptions),
    request_body = json::Question,
    responses(
        (status = 200, body = json::Reply),
        (status = 400, description = "a field is wrong", body = json::Problem, content_type = "application/problem+json"),
        (status = 404, description = "no such map or frame", body = json::Problem, content_type = "application/problem+json"),
        (status = 429, description = "too many questions of this client wait", body = json::Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn ask(
    state: State,
    NamedMap(map): NamedMap,
    Asker(client): Asker,
    Options(options): Options<WaitOptions>,
    Body(question): Body<json::Question>,
) -> Result<Json<json::Reply>, Problem> {
    let started = Instant::now();
    let question = Question::from_json(question, state.config.max_render_pixels)?;
    let reading = options.read(&map).await?;
    let snapshot = reading.snapshot.clone();
    let reply = match question {
        Question::Text(query) => {
            let text = query.text.clone();
            let engine = state.engine();
            let mut answer = state.in_time(engine.query(&client, snapshot, query)).await??;
            let reply = to_json::answer(query_id(), text, &reading, &answer);
            state.answers.keep(&reply.query_id, map.name(), &mut answer);
            json::Reply::Answer(reply)
        }
        Question::Texts(request) => {
            let texts = request.texts.clone();
            let engine = state.engine();
            let found = state.in_time(engine.segment(&client, snapshot, request)).await??;
            let reply = to_json::segmentation(query_id(), texts, &reading, &found);
            state.answers.keep_labels(&reply.query_id, map.name(), found);
            json::Reply::Segmentation(reply)
        }
    };
    metrics::histogram!(QUERY_SECONDS, "edge" => "http").record(started.elapsed());
    Ok(Json(reply))
}

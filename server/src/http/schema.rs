//! Parts of the OpenAPI document that the handlers do not write: files, and the errors that many routes
//! share.
//!
//! The errors follow from what is known of a route otherwise: who may use it (`access/rules.rs`), whether
//! it has a body, whether it is about one map. An annotation of the handler comes first.

use crate::access::rules::{self, Need};
use lexsplat_proto::json;
use utoipa::openapi::path::Operation;
use utoipa::openapi::schema::{KnownFormat, Schema, SchemaFormat, Type};
use utoipa::openapi::security::SecurityRequirement;
use utoipa::openapi::{Content, ObjectBuilder, OpenApi, Ref, RefOr, Response, ResponseBuilder};
use utoipa::{Modify, PartialSchema, ToSchema};

/// The bytes of a file, in the body of a request or an answer.
pub(super) enum Binary {}

impl PartialSchema for Binary {
    fn schema() -> RefOr<Schema> {
        let format = SchemaFormat::KnownFormat(KnownFormat::Binary);
        ObjectBuilder::new().schema_type(Type::String).format(Some(format)).into()
    }
}

impl ToSchema for Binary {}

/// Adds the errors that a route can answer with and its handler does not mention.
pub(super) struct SharedErrors;

impl Modify for SharedErrors {
    fn modify(&self, document: &mut OpenApi) {
        for (path, item) in &mut document.paths.paths {
            for (method, operation) in [
                ("GET", &mut item.get),
                ("PUT", &mut item.put),
                ("POST", &mut item.post),
                ("PATCH", &mut item.patch),
                ("DELETE", &mut item.delete),
            ] {
                if let Some(operation) = operation {
                    complete(operation, path, rules::of_http(method, path));
                }
            }
        }
    }
}

fn complete(operation: &mut Operation, path: &str, need: Option<Need>) {
    if need == Some(Need::Nothing) {
        operation.security = Some(vec![SecurityRequirement::default()]);
    }
    let has_scope = matches!(need, Some(Need::Scope(_) | Need::AllMaps(..)));
    let has_body = operation.request_body.is_some();
    let errors = [
        (
            has_scope || matches!(need, Some(Need::Known(_))),
            "401",
            "the server asks who is calling",
        ),
        (has_scope, "403", "the token lacks the scope or the map"),
        (has_body, "400", "a field is wrong"),
        (has_body, "408", "the body comes too slowly"),
        (has_body, "413", "the body is too large"),
        (has_body, "415", "the body is of another type"),
        (
            path.contains("{name}"),
            "503",
            "the map is being loaded, or nothing answers in time: try again",
        ),
        (true, "default", "the request was refused, or the server failed"),
    ];
    for (_, status, description) in errors.into_iter().filter(|(applies, ..)| *applies) {
        let responses = &mut operation.responses.responses;
        responses.entry(status.into()).or_insert_with(|| problem(description).into());
    }
}

fn problem(description: &str) -> Response {
    let schema = Ref::from_schema_name(json::Problem::name());
    let content = Content::new(Some(schema));
    ResponseBuilder::new()
        .description(description)
        .content("application/problem+json", content)
        .build()
}

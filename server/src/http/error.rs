//! Errors as RFC 9457 problem documents.

use crate::export::ExportError;
use crate::ingest::convert::Refusal;
use crate::pipeline::map::MapError;
use crate::pipeline::query::QueryError;
use crate::store::StoreError;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

/// What went wrong, as `application/problem+json`.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct Problem {
    /// A URI for the kind of problem.
    #[serde(rename = "type")]
    kind: String,
    /// The kind of problem in words.
    title: String,
    /// The HTTP status.
    #[schema(example = 400)]
    status: u16,
    /// What was expected and what was found.
    #[schema(example = "threshold: expected 0 to 1, found 3")]
    detail: String,
    /// The field at fault.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "threshold")]
    field: Option<String>,
}

impl Problem {
    /// A problem with the status's own title.
    pub fn new(status: StatusCode, detail: impl Into<String>) -> Self {
        let title = status.canonical_reason().unwrap_or("Error");
        let slug: String = title
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' })
            .collect();
        Self {
            kind: format!("urn:lexsplat:problem:{slug}"),
            title: title.into(),
            status: status.as_u16(),
            detail: detail.into(),
            field: None,
        }
    }

    /// The same, with the field at fault.
    #[must_use]
    pub fn at(mut self, field: impl Into<String>) -> Self {
        self.field = Some(field.into());
        self
    }

    /// 400.
    pub fn bad_request(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, detail)
    }

    /// 404.
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, detail)
    }

    /// 500.
    pub fn internal(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, detail)
    }

    /// 503.
    pub fn unavailable(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, detail)
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_vec(&self).expect("strings and numbers are JSON");
        (status, [(header::CONTENT_TYPE, "application/problem+json")], body).into_response()
    }
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Self {
        Self::bad_request(refusal.to_string()).at(refusal.field)
    }
}

impl From<MapError> for Problem {
    fn from(error: MapError) -> Self {
        let status = match &error {
            MapError::NotFound { .. } => StatusCode::NOT_FOUND,
            MapError::InvalidName { .. } => StatusCode::BAD_REQUEST,
            MapError::AlreadyExists { .. }
            | MapError::Busy { .. }
            | MapError::OtherCamera { .. }
            | MapError::Failed { .. } => StatusCode::CONFLICT,
            MapError::TooMany { .. } => StatusCode::TOO_MANY_REQUESTS,
        };
        let problem = Self::new(status, error.to_string());
        match error {
            MapError::NotFound { .. }
            | MapError::InvalidName { .. }
            | MapError::AlreadyExists { .. } => problem.at("name"),
            _ => problem,
        }
    }
}

impl From<QueryError> for Problem {
    fn from(error: QueryError) -> Self {
        match (&error, error.field()) {
            (QueryError::Stopped, _) => Self::unavailable(error.to_string()),
            (QueryError::UnknownFrame { .. }, Some(field)) => {
                Self::not_found(error.to_string()).at(field)
            }
            (_, Some(field)) => Self::bad_request(error.to_string()).at(field),
            (_, None) => {
                tracing::error!(error = &error as &dyn std::error::Error, "a query failed");
                Self::internal(error.to_string())
            }
        }
    }
}

impl From<ExportError> for Problem {
    fn from(error: ExportError) -> Self {
        match error {
            ExportError::Unknown { .. } => Self::not_found(error.to_string()).at("file"),
            ExportError::NotForFormat { field, .. } => {
                Self::bad_request(error.to_string()).at(field)
            }
            ExportError::Mesh(error) => error.into(),
            ExportError::Panicked => Self::internal(error.to_string()),
        }
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        tracing::error!(error = &error as &dyn std::error::Error, "the store failed");
        Self::internal("the server cannot write to its data directory: its log says why")
    }
}

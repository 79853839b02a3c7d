//! Errors as RFC 9457 problem documents (`application/problem+json`).

use super::to_json::progress;
use crate::check::Refusal;
use crate::export::ExportError;
use crate::maps::MapsError;
use crate::pipeline::map::MapError;
use crate::pipeline::query::QueryError;
use crate::store::StoreError;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use lexsplat_proto::json;

/// An error as the handlers return it.
#[derive(Debug)]
pub(crate) struct Problem(Box<json::Problem>);

/// Seconds after which a request that was refused with status 503 is worth another try.
const RETRY_AFTER: &str = "1";

impl Problem {
    /// A problem with the standard title of the status.
    pub(crate) fn new(status: StatusCode, detail: impl Into<String>) -> Self {
        let title = status.canonical_reason().unwrap_or("Error");
        let slug: String = title
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' })
            .collect();
        Self(Box::new(json::Problem {
            kind: format!("urn:lexsplat:problem:{slug}"),
            title: title.into(),
            status: status.as_u16(),
            detail: detail.into(),
            field: None,
            progress: None,
        }))
    }

    #[cfg(test)]
    pub(super) fn body(&self) -> &json::Problem {
        &self.0
    }

    /// Adds the name of the request field with the error.
    #[must_use]
    pub(crate) fn at(mut self, field: impl Into<String>) -> Self {
        self.0.field = Some(field.into());
        self
    }

    /// Status 400.
    pub(crate) fn bad_request(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, detail)
    }

    /// Status 404.
    pub(crate) fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, detail)
    }

    /// Status 500.
    pub(crate) fn internal(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, detail)
    }

    /// Status 503.
    pub(crate) fn unavailable(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, detail)
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status =
            StatusCode::from_u16(self.0.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let body = serde_json::to_vec(&self.0).expect("strings and numbers are JSON");
        let content_type = (header::CONTENT_TYPE, "application/problem+json");
        if status == StatusCode::SERVICE_UNAVAILABLE {
            return (status, [content_type, (header::RETRY_AFTER, RETRY_AFTER)], body)
                .into_response();
        }
        (status, [content_type], body).into_response()
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
            MapError::AlreadyExists { .. } | MapError::Busy { .. } | MapError::Failed { .. } => {
                StatusCode::CONFLICT
            }
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
            (QueryError::TooMany { .. }, _) => {
                Self::new(StatusCode::TOO_MANY_REQUESTS, error.to_string())
            }
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
            ExportError::TooFar(_) => Self::new(StatusCode::CONFLICT, error.to_string()).at("file"),
            ExportError::Panicked => Self::internal(error.to_string()),
        }
    }
}

impl From<MapsError> for Problem {
    fn from(error: MapsError) -> Self {
        match error {
            MapsError::Map(error) => error.into(),
            MapsError::Store(StoreError::Quota { .. }) => {
                Self::new(StatusCode::INSUFFICIENT_STORAGE, error.to_string())
            }
            MapsError::Store(error) => {
                tracing::error!(error = &error as &dyn std::error::Error, "the store failed");
                Self::internal("the server cannot write to its data directory: see its log")
            }
            MapsError::Loading { progress: ref loaded, .. } => {
                let mut problem = Self::unavailable(error.to_string());
                problem.0.progress = Some(progress(*loaded));
                problem
            }
            MapsError::OfFleet => Self::new(StatusCode::CONFLICT, error.to_string()),
            MapsError::Panicked => Self::internal(error.to_string()),
        }
    }
}

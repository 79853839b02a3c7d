//! gRPC statuses: the standard codes, with `google.rpc.BadRequest` details that name the field.

use crate::check::Refusal;
use crate::export::ExportError;
use crate::maps::MapsError;
use crate::pipeline::map::MapError;
use crate::pipeline::query::QueryError;
use prost::Message as _;
use tonic::{Code, Status};

/// `google.rpc.Status`, the content of the header `grpc-status-details-bin`.
#[derive(Clone, PartialEq, prost::Message)]
struct RichStatus {
    #[prost(int32, tag = "1")]
    code: i32,
    #[prost(string, tag = "2")]
    message: String,
    #[prost(message, repeated, tag = "3")]
    details: Vec<AnyMessage>,
}

/// `google.protobuf.Any`.
#[derive(Clone, PartialEq, prost::Message)]
struct AnyMessage {
    #[prost(string, tag = "1")]
    type_url: String,
    #[prost(bytes = "vec", tag = "2")]
    value: Vec<u8>,
}

/// `google.rpc.BadRequest`.
#[derive(Clone, PartialEq, prost::Message)]
struct BadRequest {
    #[prost(message, repeated, tag = "1")]
    field_violations: Vec<FieldViolation>,
}

/// `google.rpc.BadRequest.FieldViolation`.
#[derive(Clone, PartialEq, prost::Message)]
struct FieldViolation {
    #[prost(string, tag = "1")]
    field: String,
    #[prost(string, tag = "2")]
    description: String,
}

/// A status with `BadRequest` details that name the field.
pub(super) fn at_field(code: Code, message: &str, field: &str, description: &str) -> Status {
    let violation = FieldViolation { field: field.into(), description: description.into() };
    let detail = AnyMessage {
        type_url: "type.googleapis.com/google.rpc.BadRequest".into(),
        value: BadRequest { field_violations: vec![violation] }.encode_to_vec(),
    };
    let rich = RichStatus { code: code.into(), message: message.into(), details: vec![detail] };
    Status::with_details(code, message, rich.encode_to_vec().into())
}

/// `INVALID_ARGUMENT` for a field that did not pass a check.
pub(crate) fn refused(refusal: &Refusal) -> Status {
    at_field(Code::InvalidArgument, &refusal.to_string(), &refusal.field, &refusal.reason)
}

/// The status for an error of a recorded map; `field` is the path of the map's name in the request.
pub(super) fn of_maps(error: &MapsError, field: &str) -> Status {
    match error {
        MapsError::Map(error) => of_map(error, field),
        MapsError::Store(error) => {
            tracing::error!(error = error as &dyn std::error::Error, "the store failed");
            let reason = error.reason();
            Status::internal(format!("the server cannot write to its data directory: {reason}"))
        }
        MapsError::Loading { .. } => Status::unavailable(error.to_string()),
        MapsError::OfFleet => Status::failed_precondition(error.to_string()),
        MapsError::Panicked => Status::internal(error.to_string()),
    }
}

/// The status for an error of a map; `field` is the path of the map's name in the request.
pub(crate) fn of_map(error: &MapError, field: &str) -> Status {
    let message = error.to_string();
    let (code, field) = match error {
        MapError::NotFound { .. } => (Code::NotFound, field),
        MapError::AlreadyExists { .. } => (Code::AlreadyExists, field),
        MapError::InvalidName { .. } => (Code::InvalidArgument, field),
        MapError::TooMany { .. } => return Status::resource_exhausted(message),
        MapError::Busy { .. } => return Status::aborted(message),
        MapError::Failed { .. } => return Status::failed_precondition(message),
    };
    at_field(code, &message, field, &message)
}

/// The status for a failed query.
pub(super) fn of_query(error: &QueryError) -> Status {
    let message = error.to_string();
    match (error, error.field()) {
        (QueryError::Stopped, _) => Status::unavailable(message),
        (QueryError::TooMany { .. }, _) => Status::resource_exhausted(message),
        (QueryError::UnknownFrame { .. }, Some(field)) => {
            at_field(Code::NotFound, &message, field, &message)
        }
        (_, Some(field)) => at_field(Code::InvalidArgument, &message, field, &message),
        (_, None) => {
            tracing::error!(error = error as &dyn std::error::Error, "a query failed");
            Status::internal(message)
        }
    }
}

/// The status for a failed export.
pub(super) fn of_export(error: &ExportError) -> Status {
    let message = error.to_string();
    match error {
        ExportError::Unknown { .. } => {
            at_field(Code::InvalidArgument, &message, "format", &message)
        }
        ExportError::NotForFormat { field, .. } => {
            at_field(Code::InvalidArgument, &message, field, &message)
        }
        ExportError::Mesh(error) => of_query(error),
        ExportError::TooFar(_) => at_field(Code::FailedPrecondition, &message, "format", &message),
        ExportError::Panicked => Status::internal(message),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn details_name_the_field() {
        let status = refused(&Refusal::new("intrinsics.fx", "expected more, found 0"));
        assert_eq!(status.code(), Code::InvalidArgument);
        assert_eq!(status.message(), "intrinsics.fx: expected more, found 0");
        let rich = RichStatus::decode(status.details()).unwrap();
        assert_eq!((rich.code, rich.details.len()), (3, 1));
        let detail = BadRequest::decode(&rich.details[0].value[..]).unwrap();
        assert_eq!(detail.field_violations[0].field, "intrinsics.fx");
    }

    #[test]
    fn map_errors_have_their_codes() {
        let name = || "kitchen".to_owned();
        let code = |error: MapError| of_map(&error, "map").code();
        assert_eq!(code(MapError::NotFound { name: name() }), Code::NotFound);
        assert_eq!(code(MapError::AlreadyExists { name: name() }), Code::AlreadyExists);
        assert_eq!(code(MapError::InvalidName { name: name() }), Code::InvalidArgument);
        assert_eq!(code(MapError::Busy { name: name() }), Code::Aborted);
        assert_eq!(code(MapError::TooMany { limit: 8 }), Code::ResourceExhausted);
    }
}

//! Who may make which call: every call passes here before its handler.

use super::status;
use crate::access::{AccessError, Caller, Credentials, Gate, rules};
use crate::net::Peer;
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::Response;
use tonic::{Code, Status};

/// Lets a call pass, with its [`Caller`] in its extensions, or refuses it.
pub(super) async fn guard(State(gate): State<Gate>, mut request: Request, next: Next) -> Response {
    let path = request.uri().path();
    let Some(need) = rules::of_grpc(path) else {
        return Status::unimplemented(format!("there is no call {path}")).into_http();
    };
    // The maps of gRPC calls are named in their messages: their handlers check them.
    let peer = request.extensions().get::<Peer>().cloned().unwrap_or_default();
    match gate.admit(need, None, Credentials::of_call(request.headers(), &peer)) {
        Ok(caller) => {
            if let Some(caller) = caller {
                request.extensions_mut().insert(caller);
            }
            next.run(request).await
        }
        Err(error) => {
            tracing::info!(path, %error, "a call was refused");
            refused(&error).into_http()
        }
    }
}

/// Who made the call.
///
/// # Errors
/// `INTERNAL` if the guard did not look, which would be a mistake in the server.
pub(crate) fn caller<T>(request: &tonic::Request<T>) -> Result<Caller, Status> {
    let caller = request.extensions().get::<Caller>().cloned();
    caller.ok_or_else(|| Status::internal("nobody looked who is calling"))
}

/// Checks that the caller may use the map; `field` is the path of its name in the request.
///
/// # Errors
/// `PERMISSION_DENIED`.
pub(crate) fn permit(caller: &Caller, map: &str, field: &str) -> Result<(), Status> {
    caller.may_use(map).map_err(|error| {
        let message = error.to_string();
        status::at_field(Code::PermissionDenied, &message, field, &message)
    })
}

fn refused(error: &AccessError) -> Status {
    match error.is_unknown() {
        true => Status::unauthenticated(error.to_string()),
        false => Status::permission_denied(error.to_string()),
    }
}

//! Server reflection in both of its versions, as grpcurl and other tools use it.

use lexsplat_tests::{Server, tiny_config};
use prost::Message as _;
use tonic::transport::Channel;

/// `google.protobuf.FileDescriptorProto`, as far as needed.
#[derive(Clone, PartialEq, prost::Message)]
struct File {
    #[prost(string, tag = "2")]
    package: String,
}

/// Asks one version for the services, and for the file that has the symbol. Both versions have types of
/// their own.
macro_rules! ask {
    ($version:ident, $channel:expr) => {{
        use tonic_reflection::pb::$version::ServerReflectionRequest;
        use tonic_reflection::pb::$version::server_reflection_client::ServerReflectionClient;
        use tonic_reflection::pb::$version::server_reflection_request::MessageRequest;
        use tonic_reflection::pb::$version::server_reflection_response::MessageResponse;
        let requests = [
            MessageRequest::ListServices(String::new()),
            MessageRequest::FileContainingSymbol("lexsplat.v1.Mapping".into()),
            MessageRequest::FileContainingSymbol("lexsplat.v1.Nothing".into()),
        ];
        let requests = requests.map(|request| ServerReflectionRequest {
            host: String::new(),
            message_request: Some(request),
        });
        let mut client = ServerReflectionClient::new($channel);
        let requests = tokio_stream::iter(requests);
        let answers = client.server_reflection_info(requests).await.expect("it answers");
        let mut answers = answers.into_inner();
        let (mut services, mut files, mut error) = (Vec::new(), Vec::new(), None);
        // An unknown symbol ends the stream with a status, or is answered with an error.
        loop {
            match answers.message().await {
                Ok(Some(answer)) => match answer.message_response {
                    Some(MessageResponse::ListServicesResponse(list)) => {
                        services = list.service.into_iter().map(|service| service.name).collect();
                    }
                    Some(MessageResponse::FileDescriptorResponse(found)) => {
                        files = found.file_descriptor_proto;
                    }
                    Some(MessageResponse::ErrorResponse(found)) => error = Some(found.error_code),
                    other => panic!("{other:?}"),
                },
                Ok(None) => break,
                Err(status) => {
                    error = Some(status.code() as i32);
                    break;
                }
            }
        }
        (services, files, error)
    }};
}

fn assert_described((services, files, error): (Vec<String>, Vec<Vec<u8>>, Option<i32>)) {
    for service in ["lexsplat.v1.Mapping", "grpc.health.v1.Health"] {
        assert!(services.iter().any(|found| found == service), "{service} in {services:?}");
    }
    let file = File::decode(&*files[0]).expect("it is a descriptor");
    assert_eq!(file.package, "lexsplat.v1");
    assert_eq!(error, Some(tonic::Code::NotFound as i32), "there is no such symbol");
}

#[tokio::test(flavor = "multi_thread")]
async fn both_versions_describe_the_services() {
    let server = Server::start(tiny_config()).await;
    let address = Channel::from_shared(format!("http://{}", server.grpc)).expect("an address");
    let channel = address.connect().await.expect("it listens");
    assert_described(ask!(v1, channel.clone()));
    assert_described(ask!(v1alpha, channel));
    server.stop().await;
}

//! Answers of any size: cut into chunks, or made to fit into one message.
//!
//! In: a file, or a whole answer. Out: a stream of chunks, each far below the 4 MiB that gRPC clients take
//! if nobody says otherwise; or the answer without the arrays for which one such message has no room.

use lexsplat_proto::v1;
use prost::Message as _;
use prost::bytes::Bytes;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Status;

/// The longest message that every gRPC client takes, bytes.
const MESSAGE_BYTES: usize = 4 << 20;
/// Size of a chunk.
const CHUNK_BYTES: usize = 256 << 10;
/// Chunks that wait until the client reads them.
const CHUNK_BACKLOG: usize = 4;

/// A stream of chunks.
pub(super) type Chunks = ReceiverStream<Result<v1::Chunk, Status>>;

/// Cuts bytes into chunks. The queue of chunks is bounded; sending stops when the client leaves.
pub(super) fn chunks(bytes: impl Into<Bytes>) -> Chunks {
    let mut bytes = bytes.into();
    let (chunks, stream) = mpsc::channel(CHUNK_BACKLOG);
    tokio::spawn(async move {
        while !bytes.is_empty() {
            let data = bytes.split_to(CHUNK_BYTES.min(bytes.len()));
            if chunks.send(Ok(v1::Chunk { data })).await.is_err() {
                return;
            }
        }
    });
    ReceiverStream::new(stream)
}

/// The answer with as many of its arrays as one message has room for: the largest are left out first, and
/// named.
pub(super) fn fitting(mut response: v1::QueryResponse) -> v1::QueryResponse {
    while response.encoded_len() > MESSAGE_BYTES {
        let largest = sizes(&response).into_iter().max_by_key(|(_, bytes)| *bytes);
        match largest {
            Some((name, 1..)) => leave_out(&mut response, name),
            _ => break,
        }
    }
    response
}

/// What each array takes, bytes.
fn sizes(response: &v1::QueryResponse) -> [(&'static str, usize); 7] {
    let segmentation = response.segmentation.as_ref();
    let image = segmentation.and_then(|found| found.image.as_ref());
    let labelled = segmentation.and_then(|found| found.points.as_ref());
    let floats = size_of::<f32>();
    let image_bytes =
        |image: &Option<v1::Heatmap>| image.as_ref().map_or(0, |image| image.values.len() * floats);
    [
        ("heatmap.values", image_bytes(&response.heatmap)),
        ("uncertainty.values", image_bytes(&response.uncertainty)),
        // A count takes a byte or more.
        ("mask.counts", response.mask.as_ref().map_or(0, |mask| mask.counts.len())),
        ("boxes", response.boxes.iter().map(v1::Box::encoded_len).sum()),
        ("points.rows", response.points.as_ref().map_or(0, |p| p.rows.len() * floats)),
        ("segmentation.image.labels", image.map_or(0, |image| image.labels.len())),
        ("segmentation.points", labelled.map_or(0, |p| p.rows.len() * floats + p.labels.len())),
    ]
}

fn leave_out(response: &mut v1::QueryResponse, name: &str) {
    let segmentation = response.segmentation.as_mut();
    match name {
        "heatmap.values" => response.heatmap.iter_mut().for_each(|h| h.values.clear()),
        "uncertainty.values" => response.uncertainty.iter_mut().for_each(|u| u.values.clear()),
        "mask.counts" => response.mask.iter_mut().for_each(|mask| mask.counts.clear()),
        "boxes" => response.boxes.clear(),
        "points.rows" => response.points.iter_mut().for_each(|points| points.rows.clear()),
        "segmentation.image.labels" => {
            let image = segmentation.and_then(|found| found.image.as_mut());
            image.into_iter().for_each(|image| image.labels.clear());
        }
        _ => {
            let points = segmentation.and_then(|found| found.points.as_mut());
            points.into_iter().for_each(|points| {
                points.rows.clear();
                points.labels.clear();
            });
        }
    }
    response.left_out.push(name.to_owned());
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio_stream::StreamExt as _;

    /// An answer about a view of so many pixels, half of which are found.
    fn answer(pixels: u32) -> v1::QueryResponse {
        let values = vec![0.5; pixels as usize];
        v1::QueryResponse {
            text: "cup".into(),
            heatmap: Some(v1::Heatmap { width: pixels, height: 1, values, min: 0.5, max: 0.5 }),
            mask: Some(v1::Mask { height: 1, width: pixels, counts: vec![1; pixels as usize] }),
            boxes: vec![v1::Box { width: 5.0, ..v1::Box::default() }],
            ..v1::QueryResponse::default()
        }
    }

    #[test]
    fn what_fits_is_whole_and_the_largest_arrays_are_left_out_of_the_rest() {
        let small = answer(640 * 480);
        assert_eq!(fitting(small.clone()), small);
        let large = fitting(answer(1920 * 1080));
        assert!(large.encoded_len() <= MESSAGE_BYTES);
        assert_eq!(large.left_out, ["heatmap.values"]);
        let (heatmap, mask) = (large.heatmap.unwrap(), large.mask.unwrap());
        assert!(heatmap.values.is_empty() && heatmap.width == 1920 * 1080);
        assert!(mask.counts.len() == 1920 * 1080 && large.boxes.len() == 1);
        let huge = fitting(answer(16 << 20));
        assert_eq!(huge.left_out, ["heatmap.values", "mask.counts"]);
        assert_eq!(huge.boxes.len(), 1, "small arrays stay");
    }

    #[test]
    fn every_array_can_be_left_out() {
        let many = MESSAGE_BYTES + 1;
        let image = v1::LabelImage { width: 1, height: 1, labels: vec![0; many].into() };
        let points = v1::LabelledPoints { count: 1, rows: vec![0.0; many], labels: Bytes::new() };
        let found =
            v1::Segmentation { image: Some(image), points: Some(points), ..Default::default() };
        let whole = v1::QueryResponse {
            uncertainty: Some(v1::Heatmap { values: vec![0.0; many], ..Default::default() }),
            boxes: vec![v1::Box { x: 1.0, ..v1::Box::default() }; many / 5],
            points: Some(v1::PointSet { count: 1, rows: vec![0.0; many] }),
            segmentation: Some(found),
            ..answer(many as u32)
        };
        let small = fitting(whole);
        assert!(small.encoded_len() < 1024, "{} bytes are left", small.encoded_len());
        assert_eq!(small.left_out.len(), sizes(&small).len());
    }

    #[tokio::test]
    async fn chunks_put_together_are_what_was_cut() {
        let whole = answer(1920 * 1080);
        let parts: Vec<v1::Chunk> =
            chunks(whole.encode_to_vec()).map(|chunk| chunk.unwrap()).collect().await;
        assert!(parts.len() > 4 && parts.iter().all(|part| part.data.len() <= CHUNK_BYTES));
        let bytes = parts.iter().flat_map(|part| part.data.clone()).collect::<Vec<u8>>();
        assert_eq!(v1::QueryResponse::decode(&*bytes).unwrap(), whole);
    }
}

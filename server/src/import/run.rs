//! One recording on its way into a map.

use super::error::ImportError;
use super::progress::Import;
use super::spool::Spool;
use crate::maps::{MapsError, RecordedMaps};
use crate::pipeline::map::MapError;
use lexsplat_client::Access;
use lexsplat_client::dataset::{Dataset, DatasetError, with_poses};
use lexsplat_client::layout::Layout;
use lexsplat_client::stream::{Connection, Encoder, Poses, StreamOptions, Summary, stream_over};
use lexsplat_proto::json::{ImportPoses, ImportState};
use lexsplat_proto::v1::mapping_client::MappingClient;
use std::io::Read;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// How long a map may take for the frames that are on their way when an import is stopped.
const FREE_WITHIN: Duration = Duration::from_secs(60);
/// Between two looks whether it has.
const LOOK_AGAIN: Duration = Duration::from_millis(20);
/// Problems of frames that are told.
const TOLD: usize = 5;

/// What it takes to map a recording.
pub(super) struct Run {
    pub map: String,
    /// Where its frames go.
    pub connection: Connection,
    /// Where poses come from, if it is said.
    pub poses: Option<ImportPoses>,
    pub maps: RecordedMaps,
    pub import: Arc<Import>,
}

type Opened = oneshot::Sender<Result<(), ImportError>>;

impl Run {
    /// Receives, opens and maps a recording. `opened` is told when the first frame may come, or why none
    /// will.
    pub(super) async fn map(
        self,
        spool: Result<Spool, ImportError>,
        recording: impl Read + Send + 'static,
        opened: Opened,
    ) {
        let mut opened = Some(opened);
        let stop = self.import.stop.clone();
        let ended = tokio::select! {
            ended = self.mapped(spool, recording, &mut opened) => ended,
            () = stop.cancelled() => Err(ImportError::Stopped),
        };
        if matches!(ended, Err(ImportError::Stopped)) {
            self.until_free().await;
        }
        let mut told = self.import.told();
        told.state = match &ended {
            Ok(()) => ImportState::Done,
            Err(ImportError::Stopped) => ImportState::Stopped,
            Err(_) => ImportState::Failed,
        };
        if let Err(error) = ended {
            tracing::info!(map = self.map, %error, "a recording was not mapped to its end");
            if !matches!(error, ImportError::Stopped) {
                told.error = Some(error.to_string());
            }
            // If this fails, nobody waits, or it was told before.
            let _ = opened.take().map(|opened| opened.send(Err(error)));
        }
        self.import.ended.cancel();
    }

    /// Waits until the map has taken what was on its way.
    async fn until_free(&self) {
        let began = Instant::now();
        while began.elapsed() < FREE_WITHIN
            && matches!(
                self.maps.expect_free(&self.map),
                Err(MapsError::Map(MapError::Busy { .. }))
            )
        {
            tokio::time::sleep(LOOK_AGAIN).await;
        }
    }

    async fn mapped(
        &self,
        spool: Result<Spool, ImportError>,
        recording: impl Read + Send + 'static,
        opened: &mut Option<Opened>,
    ) -> Result<(), ImportError> {
        let (spool, asked) = (Arc::new(spool?), self.poses);
        let receiving = spool.clone();
        let received = tokio::task::spawn_blocking(move || {
            let (layout, dataset) = receiving.receive(recording)?;
            let posed = posed(dataset, asked).map_err(|error| match error {
                DatasetError::NoPoses { reason, .. } => {
                    let advice = "let the server estimate the poses (poses=estimated)";
                    receiving.refused(&format!("no frame has a pose ({reason}): {advice}"))
                }
                error => receiving.refused(&error.whole()),
            });
            posed.map(|(poses, dataset)| (layout, poses, dataset))
        });
        let (layout, poses, dataset) = received.await.map_err(|_| ImportError::Panicked)??;
        self.tell(&spool, layout, poses, &*dataset);
        let options = StreamOptions {
            grpc: "this server".into(),
            access: Access::default(),
            map: self.map.clone(),
            poses: match poses {
                ImportPoses::Given => Poses::Given,
                ImportPoses::Estimated => Poses::Estimate,
            },
            encoder: Encoder::Bundle,
            hold_out_every: None,
            realtime: false,
        };
        let client = MappingClient::new(self.connection.clone());
        let summary = stream_over(client, Arc::from(dataset), &options, |progress| {
            let mut told = self.import.told();
            told.state = ImportState::Mapping;
            (told.frames_done, told.frames_total) = (progress.acknowledged, progress.total);
            drop(told);
            let _ = opened.take().map(|opened| opened.send(Ok(())));
        });
        self.tell_outcome(&spool, &summary.await?);
        Ok(())
    }

    fn tell(&self, spool: &Spool, layout: Layout, poses: ImportPoses, dataset: &dyn Dataset) {
        let mut told = self.import.told();
        told.layout = Some(layout.name().into());
        told.poses = Some(poses);
        told.frames_total = dataset.len() as u64;
        told.frames_left_out = dataset.skipped().len() as u64;
        told.notes = dataset.notes().iter().map(|note| spool.plain(note)).collect();
        told.problems = dataset.skipped().iter().take(TOLD).map(|why| spool.plain(why)).collect();
    }

    fn tell_outcome(&self, spool: &Spool, summary: &Summary) {
        let mut told = self.import.told();
        told.frames_resumed_past = summary.resumed_past;
        told.frames_refused = summary.refused;
        told.frames_left_out += summary.left_out;
        let left_out = summary.left_out_frames.iter();
        let left_out = left_out.map(|frame| format!("frame {}: {}", frame.sequence, frame.reason));
        let refused = summary.refusals.iter().map(|refusal| {
            format!("frame {}: {}: {}", refusal.sequence, refusal.field, refusal.reason)
        });
        let all = refused.chain(left_out).map(|problem| spool.plain(&problem));
        told.problems.extend(all);
    }
}

type Posed = (ImportPoses, Box<dyn Dataset>);

/// The frames that are mapped: poses are given if most frames have one, unless it is said.
fn posed(dataset: Box<dyn Dataset>, asked: Option<ImportPoses>) -> Result<Posed, DatasetError> {
    let without = (0..dataset.len()).filter(|&at| dataset.no_pose(at).is_some()).count();
    let usual =
        if 2 * without > dataset.len() { ImportPoses::Estimated } else { ImportPoses::Given };
    match asked.unwrap_or(usual) {
        ImportPoses::Given => Ok((ImportPoses::Given, with_poses(dataset)?)),
        ImportPoses::Estimated => Ok((ImportPoses::Estimated, dataset)),
    }
}

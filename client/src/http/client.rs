//! Requests to one server: questions, images, files and numbers of its maps. It writes no file.

use super::connect::{base, client};
use super::error::{HttpError, detail, is_loading};
use super::links::{Linked, resolve};
use super::map_file::{MapFile, ReadOf};
use crate::access::{Access, innermost, is_refused};
use crate::npy::{self, Array};
use lexsplat_proto::json::{
    Answer, Frames, Health, HeatmapLink, Keyframe, LabelsLink, PointsLink, Question, Segmentation,
    Status,
};
use reqwest::{RequestBuilder, Response, Url, header};
use serde::de::DeserializeOwned;
use std::time::{Duration, Instant};

/// A client of one server.
#[derive(Clone, Debug)]
pub struct HttpClient {
    base: Url,
    pub(super) client: reqwest::Client,
    /// How long the server may wait before it reads the map, seconds.
    wait_seconds: Option<u64>,
    wait: &'static str,
}

/// How long a request waits for a map that the server is loading.
const LOADING: Duration = Duration::from_secs(600);
/// Between two tries.
const RETRY: Duration = Duration::from_secs(1);

impl HttpClient {
    /// The server at `HOST:PORT`, `http://HOST:PORT` or `https://HOST:PORT`, with a path where a proxy
    /// shows it below one; connects when first asked.
    ///
    /// # Errors
    /// [`HttpError::Address`].
    pub fn new(address: &str) -> Result<Self, HttpError> {
        Self::with_access(address, &Access::default())
    }

    /// The same, with a token or certificates.
    ///
    /// # Errors
    /// [`HttpError::Address`], [`HttpError::Access`].
    pub fn with_access(address: &str, access: &Access) -> Result<Self, HttpError> {
        Ok(Self {
            base: base(address)?,
            client: client(access)?,
            wait_seconds: None,
            wait: "settled",
        })
    }

    /// Questions, exports and trajectories wait in the server, at most so long, until the map has used all
    /// acknowledged frames. Afterwards they are of what there is, and say so.
    #[must_use]
    pub fn waiting(self, seconds: u64) -> Self {
        Self { wait_seconds: Some(seconds), ..self }
    }

    /// It waits until the map has been refined as well.
    #[must_use]
    pub fn until_converged(self) -> Self {
        Self { wait: "converged", ..self }
    }

    /// `HOST:PORT`.
    pub fn address(&self) -> String {
        self.base.authority().to_owned()
    }

    /// The status of a map.
    ///
    /// # Errors
    /// Every [`HttpError`] but `Address`; so do all other requests.
    pub async fn status(&self, map: &str) -> Result<Status, HttpError> {
        self.json(self.client.get(self.url(map, &[]))).await
    }

    /// The server's graphics adapter, networks and version.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn health(&self) -> Result<Health, HttpError> {
        self.json(self.client.get(self.path(&["healthz"]))).await
    }

    /// The server's metrics as Prometheus text.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn metrics(&self) -> Result<String, HttpError> {
        let bytes = self.bytes(self.client.get(self.path(&["metrics"]))).await?;
        String::from_utf8(bytes).map_err(|error| self.broken(error.to_string()))
    }

    /// The map's keyframes.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn frames(&self, map: &str) -> Result<Vec<Keyframe>, HttpError> {
        let frames: Frames = self.json(self.client.get(self.url(map, &["frames"]))).await?;
        Ok(frames.frames)
    }

    /// Asks a question.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn query(&self, map: &str, question: &Question) -> Result<Answer, HttpError> {
        self.ask(map, question).await
    }

    /// Labels pixels or Gaussians with several texts.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn segment(&self, map: &str, question: &Question) -> Result<Segmentation, HttpError> {
        self.ask(map, question).await
    }

    /// The labels of a view's pixels in the media type `accept`, such as a PNG with a palette.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn labels(&self, link: &LabelsLink, accept: &str) -> Result<Vec<u8>, HttpError> {
        self.linked(&link.url, accept).await
    }

    /// The heat map of an answer: relevancies `[height, width]`, and the .npy file that they came
    /// in.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn heatmap(&self, link: &HeatmapLink) -> Result<(Array, Vec<u8>), HttpError> {
        let file = self.linked(&link.url, "application/x-npy").await?;
        let array = npy::read(&file).map_err(|error| self.broken(error.to_string()))?;
        let expected = [link.height as usize, link.width as usize];
        if array.shape != expected {
            let reason = format!("heat map: expected shape {expected:?}, found {:?}", array.shape);
            return Err(self.broken(reason));
        }
        Ok((array, file))
    }

    /// An answer's heat map as PNG.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn heatmap_png(&self, link: &HeatmapLink) -> Result<Vec<u8>, HttpError> {
        self.linked(&link.url, "image/png").await
    }

    /// An answer's points (x, y, z, score) as PLY.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn points_ply(&self, link: &PointsLink) -> Result<Vec<u8>, HttpError> {
        self.linked(&link.url, "application/octet-stream").await
    }

    /// An answer's points, `[count, 4]`: x, y, z in metres of the map's world, score.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn points(&self, link: &PointsLink) -> Result<Array, HttpError> {
        let file = self.linked(&link.url, "application/x-npy").await?;
        let array = npy::read(&file).map_err(|error| self.broken(error.to_string()))?;
        if array.shape != [link.count, 4] {
            let (count, shape) = (link.count, array.shape);
            return Err(
                self.broken(format!("points: expected shape [{count}, 4], found {shape:?}"))
            );
        }
        Ok(array)
    }

    /// The map rendered at the pose of a tracked frame, as PNG.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn render_png(&self, map: &str, sequence: u64) -> Result<Vec<u8>, HttpError> {
        let frame = sequence.to_string();
        self.bytes(self.client.get(self.url(map, &["render"])).query(&[("frame", frame)])).await
    }

    /// The depth rendered at the pose of a tracked frame, `[height, width]` in metres, 0 where it
    /// is unknown.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn render_depth(&self, map: &str, sequence: u64) -> Result<Array, HttpError> {
        let frame = sequence.to_string();
        let options = [("frame", frame.as_str()), ("channel", "depth")];
        let request = self.client.get(self.url(map, &["render"])).query(&options);
        let file = self.bytes(request.header(header::ACCEPT, "application/x-npy")).await?;
        npy::read(&file).map_err(|error| self.broken(error.to_string()))
    }

    /// The poses of all tracked frames as TUM text.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn trajectory(&self, map: &str) -> Result<MapFile, HttpError> {
        let request = self.read(self.client.get(self.url(map, &["trajectory"])));
        let response = self.send(request).await?;
        let of = ReadOf::from_headers(response.headers());
        let bytes = response.bytes().await.map_err(|error| self.lost(&error))?.into();
        Ok(MapFile { bytes, of })
    }

    /// The map as a file such as `splats.ply`, with options such as `voxel_metres`. `progress` gets the
    /// bytes so far and the total, if it is known.
    ///
    /// # Errors
    /// See [`Self::status`].
    pub async fn export(
        &self,
        map: &str,
        file: &str,
        options: &[(&str, String)],
        mut progress: impl FnMut(u64, Option<u64>),
    ) -> Result<MapFile, HttpError> {
        let request = self.read(self.client.get(self.url(map, &["export", file]))).query(options);
        let mut response = self.send(request).await?;
        let of = ReadOf::from_headers(response.headers());
        let total = response.content_length();
        let mut bytes = Vec::new();
        while let Some(chunk) = response.chunk().await.map_err(|error| self.lost(&error))? {
            bytes.extend_from_slice(&chunk);
            progress(bytes.len() as u64, total);
        }
        Ok(MapFile { bytes, of })
    }

    /// A request that waits as [`Self::waiting`] says.
    fn read(&self, request: RequestBuilder) -> RequestBuilder {
        match self.wait_seconds {
            Some(seconds) => {
                let seconds = seconds.to_string();
                request.query(&[("wait", self.wait), ("wait_seconds", &seconds)])
            }
            None => request,
        }
    }

    pub(super) fn url(&self, map: &str, rest: &[&str]) -> Url {
        self.path(&[&["v1", "maps", map], rest].concat())
    }

    pub(super) fn path(&self, segments: &[&str]) -> Url {
        let mut url = self.base.clone();
        url.path_segments_mut().expect("an http address has a path").extend(segments);
        url
    }

    /// Asks a question; the links of the answer are whole addresses.
    async fn ask<T: DeserializeOwned + Linked>(
        &self,
        map: &str,
        question: &Question,
    ) -> Result<T, HttpError> {
        let url = self.url(map, &["query"]);
        let post = self.read(self.client.post(url.clone())).json(question);
        let mut answer: T = self.json(post).await?;
        resolve(&url, &mut answer).map_err(|reason| self.broken(reason))?;
        Ok(answer)
    }

    async fn linked(&self, link: &str, accept: &str) -> Result<Vec<u8>, HttpError> {
        self.bytes(self.client.get(link).header(header::ACCEPT, accept)).await
    }

    pub(super) async fn json<T: DeserializeOwned>(
        &self,
        request: RequestBuilder,
    ) -> Result<T, HttpError> {
        let bytes = self.bytes(request).await?;
        serde_json::from_slice(&bytes).map_err(|error| self.broken(error.to_string()))
    }

    async fn bytes(&self, request: RequestBuilder) -> Result<Vec<u8>, HttpError> {
        let response = self.send(request).await?;
        Ok(response.bytes().await.map_err(|error| self.lost(&error))?.into())
    }

    /// Sends a request; again and again while the map that it needs is being loaded.
    pub(super) async fn send(&self, mut request: RequestBuilder) -> Result<Response, HttpError> {
        let began = Instant::now();
        loop {
            let again = request.try_clone();
            let response = request.send().await.map_err(|error| self.lost(&error))?;
            let status = response.status();
            if status.is_success() {
                return Ok(response);
            }
            let body = response.bytes().await.map_err(|error| self.lost(&error))?;
            let Some(again) = again.filter(|_| is_loading(&body) && began.elapsed() < LOADING)
            else {
                let detail = detail(&body, status.as_str());
                return Err(HttpError::Refused { status: status.as_u16(), detail });
            };
            tokio::time::sleep(RETRY).await;
            request = again;
        }
    }

    pub(super) fn lost(&self, error: &reqwest::Error) -> HttpError {
        let (address, reason) = (self.address(), innermost(error));
        match self.base.scheme() {
            _ if !error.is_connect() => self.broken(reason.to_string()),
            "https" if !is_refused(reason) => {
                HttpError::Tls { address, reason: reason.to_string() }
            }
            _ => HttpError::NoServer { address },
        }
    }

    fn broken(&self, reason: String) -> HttpError {
        HttpError::Broken { address: self.address(), reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_may_have_a_scheme_and_names_are_escaped() {
        for address in ["127.0.0.1:8080", "http://127.0.0.1:8080"] {
            let client = HttpClient::new(address).unwrap();
            assert_eq!(client.address(), "127.0.0.1:8080");
            let url = client.url("a/b c", &["frames"]);
            assert_eq!(url.as_str(), "http://127.0.0.1:8080/v1/maps/a%2Fb%20c/frames");
        }
        for prefixed in ["http://host/robots/kitchen", "http://host/robots/kitchen/"] {
            let url = HttpClient::new(prefixed).unwrap().url("a", &["frames"]);
            assert_eq!(url.as_str(), "http://host/robots/kitchen/v1/maps/a/frames");
        }
        let client = HttpClient::new("https://127.0.0.1:8080").unwrap();
        assert_eq!(client.url("a", &[]).as_str(), "https://127.0.0.1:8080/v1/maps/a");
        for wrong in ["127.0.0.1:http", "ftp://127.0.0.1:8080", "https://"] {
            let error = HttpClient::new(wrong).unwrap_err();
            assert!(error.to_string().contains(wrong), "{error}");
        }
    }

    #[tokio::test]
    async fn a_missing_server_is_named() {
        // A port that was free a moment ago.
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let client = HttpClient::new(&format!("127.0.0.1:{port}")).unwrap();
        let error = client.status("kitchen").await.unwrap_err();
        assert!(matches!(error, HttpError::NoServer { .. }), "{error}");
        assert!(error.to_string().contains("start lexsplat-server"));
    }
}

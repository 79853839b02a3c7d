//! Queries at a constant rate: each is asked when it is due, whether or not the last one is
//! answered.

use super::plan::Plan;
use super::report::QueryReport;
use lexsplat_client::http::{HttpClient, Question};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinSet;
use tokio::time::Instant;

/// Queries that may wait for answers; one that is due beyond that is counted and not asked.
const MOST_WAITING: usize = 1024;
/// The frame of queries about a view: the first of every map.
const FRAME: u64 = 0;
/// Interval at which an empty map is checked for its first frames.
const POLL: Duration = Duration::from_millis(50);

/// Asks all queries.
pub(super) struct Asker {
    http: HttpClient,
    maps: Vec<String>,
    texts: Vec<String>,
    per_second: f64,
}

/// The outcome of one query.
struct Asked {
    about_view: bool,
    latency: Result<Duration, String>,
}

impl Asker {
    pub(super) fn new(plan: &Plan, http: &HttpClient, maps: &[String]) -> Self {
        Self {
            http: http.clone(),
            maps: maps.to_vec(),
            texts: plan.texts.clone(),
            per_second: plan.queries_per_second,
        }
    }

    /// Asks the queries that are due until `end`, once every map has frames, and waits for the
    /// answers.
    pub(super) async fn run(
        self,
        mut started: watch::Receiver<usize>,
        end: Instant,
    ) -> QueryReport {
        let mut report = QueryReport { due_per_second: self.per_second, ..QueryReport::default() };
        let robots = self.maps.len();
        let ready = async {
            let acknowledged = started.wait_for(|count| *count >= robots).await.is_ok();
            acknowledged && self.readable().await
        };
        let ready = tokio::time::timeout_at(end, ready).await.unwrap_or(false);
        if self.per_second <= 0.0 || !ready {
            return report;
        }
        let begin = Instant::now();
        let places = Arc::new(Semaphore::new(MOST_WAITING));
        let mut asking = JoinSet::new();
        for number in 0_usize.. {
            let due = begin + Duration::from_secs_f64(number as f64 / self.per_second);
            if due >= end {
                break;
            }
            tokio::time::sleep_until(due).await;
            match places.clone().try_acquire_owned() {
                Err(_) => report.not_asked += 1,
                Ok(place) => {
                    let (http, map, question) = self.question(number);
                    asking.spawn(async move {
                        let answer = http.query(&map, &question).await;
                        drop(place);
                        let latency = answer.map(|_| due.elapsed());
                        let latency = latency.map_err(|error| error.to_string());
                        Asked { about_view: question.view.is_some(), latency }
                    });
                }
            }
        }
        let mut latencies = [Vec::new(), Vec::new()];
        while let Some(joined) = asking.join_next().await {
            match joined.map(|asked| (asked.about_view, asked.latency)) {
                Ok((about_view, Ok(latency))) => latencies[usize::from(about_view)].push(latency),
                Ok((_, Err(reason))) => report.fail(reason),
                Err(error) => report.fail(error.to_string()),
            }
        }
        let [space, view] = latencies;
        report.set_answered(view, space, begin.elapsed());
        report
    }

    /// Waits until every map has frames; false if a request fails.
    async fn readable(&self) -> bool {
        for map in &self.maps {
            loop {
                match self.http.frames(map).await {
                    Ok(frames) if frames.is_empty() => tokio::time::sleep(POLL).await,
                    Ok(_) => break,
                    Err(_) => return false,
                }
            }
        }
        true
    }

    /// Query `number`: texts, kinds (view, whole map) and maps take turns.
    fn question(&self, number: usize) -> (HttpClient, String, Question) {
        let text = &self.texts[number / 2 % self.texts.len()];
        let question = match number % 2 {
            0 => Question::in_frame(text, FRAME),
            _ => Question::in_space(text),
        };
        (self.http.clone(), self.maps[number / 2 % self.maps.len()].clone(), question)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn questions_take_turns() {
        let asker = Asker {
            http: HttpClient::new("127.0.0.1:1").unwrap(),
            maps: vec!["a".into(), "b".into()],
            texts: vec!["cup".into(), "sofa".into(), "lamp".into()],
            per_second: 1.0,
        };
        let asked = |number| {
            let (_, map, question) = asker.question(number);
            (map, question.text, question.view.is_some())
        };
        assert_eq!(asked(0), ("a".into(), Some("cup".into()), true));
        assert_eq!(asked(1), ("a".into(), Some("cup".into()), false));
        assert_eq!(asked(2), ("b".into(), Some("sofa".into()), true));
        assert_eq!(asked(4), ("a".into(), Some("lamp".into()), true));
    }

    /// The latency of a query counts from the time that it was due, also if the server is late.
    #[tokio::test]
    async fn latency_counts_from_the_time_a_query_is_due() {
        use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap().to_string();
        // Answers one connection at a time, each after 100 ms; questions come every 20 ms. The body
        // is an answer and, for who asks for frames, one frame.
        tokio::spawn(async move {
            while let Ok((mut connection, _)) = listener.accept().await {
                let mut request = [0; 4096];
                let _ = connection.read(&mut request).await;
                tokio::time::sleep(Duration::from_millis(100)).await;
                let body = r#"{"query_id":"q","text":"cup","map":"a","revision":1,"present":true,
                    "confidence":1,"coverage":1,"threshold":0.5,
                    "timing_ms":{"text":0,"render":0,"decode":0,"score":0,"total":0},
                    "frames":[{"sequence":0,"timestamp":0,"timestamp_nanos":0,"has_language":true,
                    "world_from_camera":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],
                    "camera":{"width":1,"height":1,"fx":1,"fy":1,"cx":0,"cy":0}}]}"#;
                let length = body.len();
                let head = format!(
                    "HTTP/1.1 200 OK\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n"
                );
                let _ = connection.write_all(format!("{head}{body}").as_bytes()).await;
            }
        });
        let asker = Asker {
            http: HttpClient::new(&address).unwrap(),
            maps: vec!["a".into()],
            texts: vec!["cup".into()],
            per_second: 50.0,
        };
        let (_robots, started) = watch::channel(1);
        let end = Instant::now() + Duration::from_millis(500);
        let report = asker.run(started, end).await;
        assert_eq!((report.failed, report.not_asked), (0, 0), "{:?}", report.first_failure);
        assert!((2..=26).contains(&report.answered), "{report:?}");
        // 100 ms each, one behind the other, due 20 ms apart: the last has waited for all of them.
        let least = 80.0 * (report.answered - 1) as f64;
        assert!(report.latency_ms.max > least, "{:?}", report.latency_ms);
    }
}

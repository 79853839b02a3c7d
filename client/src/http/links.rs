//! The links of an answer, made whole addresses.
//!
//! The server names parts of an answer relative to the address that was asked, since it does not know below
//! which path a proxy shows it. In: an answer and the address of its question. Out: the same answer, whose
//! links can be followed as they are. A link to another server is refused: the token would go there.

use lexsplat_proto::json::{Answer, Segmentation};
use reqwest::Url;

/// An answer with links.
pub(super) trait Linked {
    /// Each link that it has.
    fn links(&mut self) -> Vec<&mut String>;
}

impl Linked for Answer {
    fn links(&mut self) -> Vec<&mut String> {
        let images = [&mut self.heatmap, &mut self.uncertainty].into_iter().flatten();
        let points = self.points.as_mut().map(|link| &mut link.url);
        images.map(|link| &mut link.url).chain(points).collect()
    }
}

impl Linked for Segmentation {
    fn links(&mut self) -> Vec<&mut String> {
        let labels = self.labels.as_mut().map(|link| &mut link.url);
        let points = self.points.as_mut().map(|link| &mut link.url);
        labels.into_iter().chain(points).collect()
    }
}

/// Resolves the links of an answer to a question that was sent to `asked`.
///
/// # Errors
/// What is wrong with a link.
pub(super) fn resolve(asked: &Url, answer: &mut impl Linked) -> Result<(), String> {
    for link in answer.links() {
        let url = asked.join(link).map_err(|error| format!("link {link:?}: {error}"))?;
        if url.origin() != asked.origin() {
            return Err(format!("link {link:?} leads to another server"));
        }
        *link = url.into();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Links([String; 1]);

    impl Linked for Links {
        fn links(&mut self) -> Vec<&mut String> {
            self.0.iter_mut().collect()
        }
    }

    #[test]
    fn links_stay_below_the_prefix_and_on_the_server() {
        let asked = Url::parse("http://host:80/robots/kitchen/v1/maps/room/query?wait=settled");
        let asked = asked.unwrap();
        let resolved = |link: &str| {
            let mut links = Links([link.into()]);
            resolve(&asked, &mut links).map(|()| links.0[0].clone())
        };
        let below = "http://host/robots/kitchen/v1/maps/room/queries/7/heatmap";
        assert_eq!(resolved("queries/7/heatmap").unwrap(), below);
        // Negative control: an absolute path, as earlier servers sent it, leaves the prefix.
        assert_ne!(resolved("/v1/maps/room/queries/7/heatmap").unwrap(), below);
        for elsewhere in ["http://evil.example/x", "//evil.example/x", "https://host/x"] {
            assert!(resolved(elsewhere).unwrap_err().contains("another server"), "{elsewhere}");
        }
    }
}

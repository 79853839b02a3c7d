//! All callers that the server knows: the lines of the tokens file and of the settings.

use super::config::AccessConfig;
use super::entry::Entry;
use super::token::TokenHash;
use std::path::PathBuf;

/// Why the callers cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum EntriesError {
    /// The tokens file cannot be read.
    #[error("cannot read the tokens file {}: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        reason: std::io::Error,
    },
    /// A line is malformed.
    #[error("{place}: {reason}")]
    Line {
        /// File and line.
        place: String,
        /// What was expected and what was found.
        reason: String,
    },
}

/// The callers, in the order of the lines.
#[derive(Debug, Default)]
pub(super) struct Entries(Vec<Entry>);

impl Entries {
    /// Reads the tokens file and the lines of the settings.
    ///
    /// # Errors
    /// [`EntriesError`].
    pub(super) fn load(config: &AccessConfig) -> Result<Self, EntriesError> {
        let mut entries = Self::default();
        for (number, line) in (1..).zip(&config.entries) {
            entries.add(line, || format!("access.entries, entry {number}"))?;
        }
        let Some(path) = &config.tokens else { return Ok(entries) };
        let text = std::fs::read_to_string(path)
            .map_err(|reason| EntriesError::Unreadable { path: path.clone(), reason })?;
        for (number, line) in (1..).zip(text.lines()) {
            entries.add(line, || format!("{}, line {number}", path.display()))?;
        }
        Ok(entries)
    }

    /// Adds a line; comments and empty lines have no effect.
    fn add(&mut self, line: &str, place: impl Fn() -> String) -> Result<(), EntriesError> {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            return Ok(());
        }
        let wrong = |reason| EntriesError::Line { place: place(), reason };
        let entry = Entry::parse(line).map_err(wrong)?;
        if self.named(&entry.name).is_some() {
            return Err(wrong(format!("there is another caller called {:?}", entry.name)));
        }
        self.0.push(entry);
        Ok(())
    }

    /// Puts these in the place of `old`. Callers whose line is the same stay, the others are withdrawn.
    pub(super) fn replacing(mut self, old: &Self) -> Self {
        for before in &old.0 {
            let same = self.0.iter_mut().find(|entry| entry.to_line() == before.to_line());
            match same {
                Some(entry) => entry.withdrawn = before.withdrawn.clone(),
                None => before.withdrawn.cancel(),
            }
        }
        self
    }

    pub(super) fn count(&self) -> usize {
        self.0.len()
    }

    /// The caller with this token. All hashes are compared, so that the time says nothing.
    pub(super) fn with_token(&self, token: &str) -> Option<&Entry> {
        let hash = TokenHash::of(token);
        let has_it = |entry: &Entry| entry.token.is_some_and(|known| known.is(&hash));
        self.0.iter().fold(None, |found, entry| if has_it(entry) { Some(entry) } else { found })
    }

    pub(super) fn named(&self, name: &str) -> Option<&Entry> {
        self.0.iter().find(|entry| entry.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(entries: &[&str]) -> AccessConfig {
        let entries = entries.iter().map(|line| (*line).to_owned()).collect();
        AccessConfig { entries, ..AccessConfig::default() }
    }

    #[test]
    fn lines_of_file_and_settings_are_added() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens");
        let line = |name, token| format!("{name} read * {}", TokenHash::of(token).to_text());
        std::fs::write(&path, format!("# robots\n\n{}\n", line("b", "2"))).unwrap();
        let config = AccessConfig { tokens: Some(path.clone()), ..config(&[&line("a", "1")]) };
        let entries = Entries::load(&config).unwrap();
        assert_eq!(entries.count(), 2);
        assert_eq!(entries.with_token("1").unwrap().name, "a");
        assert_eq!(entries.with_token("2").unwrap().name, "b");
        assert!(entries.with_token("3").is_none() && entries.with_token("").is_none());
        std::fs::write(&path, "\nc read *\n").unwrap();
        let error = Entries::load(&config).unwrap_err().to_string();
        assert!(error.contains("tokens, line 2: expected NAME"), "{error}");
        std::fs::write(&path, line("a", "2")).unwrap();
        let error = Entries::load(&config).unwrap_err().to_string();
        assert!(error.contains("line 1: there is another caller called \"a\""), "{error}");
        std::fs::remove_file(&path).unwrap();
        let error = Entries::load(&config).unwrap_err().to_string();
        assert!(error.contains("cannot read the tokens file"), "{error}");
    }

    #[test]
    fn callers_whose_line_is_gone_or_changed_are_withdrawn() {
        let load = |lines: &[&str]| Entries::load(&config(lines)).unwrap();
        let old = load(&["a read * certificate", "b read * certificate", "c read * certificate"]);
        let new = load(&["c read * certificate", "b read hall certificate"]).replacing(&old);
        let withdrawn = |of: &Entries, name| of.named(name).unwrap().withdrawn.is_cancelled();
        assert!(withdrawn(&old, "a") && withdrawn(&old, "b") && !withdrawn(&old, "c"));
        assert!(!withdrawn(&new, "b") && !withdrawn(&new, "c"));
        let newest = load(&[]).replacing(&new);
        assert!(withdrawn(&new, "b") && withdrawn(&old, "c") && newest.count() == 0);
    }

    #[test]
    fn a_caller_without_a_token_is_found_by_name_only() {
        let entries = Entries::load(&config(&["a write * certificate"])).unwrap();
        assert!(entries.named("a").is_some() && entries.named("b").is_none());
        assert!(entries.with_token("certificate").is_none() && entries.with_token("").is_none());
    }
}

//! Making a token: `lexsplat-server token`.

use super::config::AccessConfig;
use super::entries::{Entries, EntriesError};
use super::entry::Entry;
use super::scope::Scope;
use super::token::{TokenHash, new_token};
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

/// Why no token was made.
#[derive(Debug, thiserror::Error)]
pub enum IssueError {
    /// The tokens file cannot be read, or has a malformed line.
    #[error(transparent)]
    Entries(#[from] EntriesError),
    /// Name, scopes or maps are malformed, or the name is taken.
    #[error("{0}")]
    Wrong(String),
    /// The system has no random numbers.
    #[error("the system has no random numbers: {0}")]
    Random(String),
    /// The tokens file cannot be written.
    #[error("cannot write the tokens file: {0}")]
    Write(#[from] std::io::Error),
}

/// Makes a token, adds its line to `file` if there is one, and returns token and line. The file is
/// created if it is missing, for its owner's eyes only.
///
/// # Errors
/// [`IssueError`].
pub fn issue(
    name: &str,
    scopes: &[Scope],
    maps: &str,
    file: Option<&Path>,
) -> Result<(String, String), IssueError> {
    let token = new_token().map_err(IssueError::Random)?;
    let scopes: Vec<&str> = scopes.iter().map(|scope| scope.as_str()).collect();
    let hash = TokenHash::of(&token).to_text();
    let line = format!("{name} {} {maps} {hash}", scopes.join(","));
    let line = Entry::parse(&line).map_err(IssueError::Wrong)?.to_line();
    let Some(path) = file else { return Ok((token, line)) };
    if path.exists() {
        let config = AccessConfig { tokens: Some(path.into()), ..AccessConfig::default() };
        if Entries::load(&config)?.named(name).is_some() {
            let path = path.display();
            return Err(IssueError::Wrong(format!(
                "{path} has a caller called {name:?}: take another name, or remove that line"
            )));
        }
    }
    let mut options = std::fs::OpenOptions::new();
    let mut file = options.create(true).append(true).read(true).mode(0o600).open(path)?;
    let text = std::fs::read_to_string(path)?;
    // The file's last line may lack its end.
    let start = if text.is_empty() || text.ends_with('\n') { "" } else { "\n" };
    file.write_all(format!("{start}{line}\n").as_bytes())?;
    file.sync_all()?;
    Ok((token, line))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn a_line_is_added_for_each_token_and_names_are_not_taken_twice() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tokens");
        let (first, line) = issue("a", &[Scope::Read], "kitchen*", Some(&path)).unwrap();
        assert!(line.starts_with("a read kitchen* sha256:") && !line.contains(&first), "{line}");
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        // Somebody wrote a comment without a line's end.
        let text = std::fs::read_to_string(&path).unwrap() + "# end";
        std::fs::write(&path, text).unwrap();
        let (second, _) = issue("b", &Scope::ALL, "*", Some(&path)).unwrap();
        let config = AccessConfig { tokens: Some(path.clone()), ..AccessConfig::default() };
        let entries = Entries::load(&config).unwrap();
        assert_eq!(entries.with_token(&first).unwrap().name, "a");
        assert_eq!(entries.with_token(&second).unwrap().name, "b");
        let error = issue("b", &[Scope::Read], "*", Some(&path)).unwrap_err().to_string();
        assert!(error.contains("has a caller called \"b\""), "{error}");
        assert!(issue("a b", &[Scope::Read], "*", None).is_err());
        assert!(issue("a", &[], "*", None).is_err());
        assert!(issue("a", &[Scope::Read], "x/y", None).is_err());
    }
}

//! One caller of the tokens file: `NAME SCOPES MAPS HASH`, separated by spaces.

use super::scope::Scope;
use super::token::TokenHash;
use tokio_util::sync::CancellationToken;

/// In place of a hash: no token, the caller is known by a client certificate only.
const NO_TOKEN: &str = "certificate";
/// Longest name, bytes.
const MAX_NAME_BYTES: usize = 64;

/// A caller that the server knows.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub(super) name: String,
    pub(super) scopes: Vec<Scope>,
    pub(super) maps: Maps,
    pub(super) token: Option<TokenHash>,
    /// Cancelled when the line is removed or changed.
    pub(super) withdrawn: CancellationToken,
}

/// The maps that a caller may use: patterns separated by commas, each with at most one `*`, which
/// stands for any characters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Maps(Vec<String>);

impl Maps {
    pub(super) fn every() -> Self {
        Self(vec!["*".into()])
    }

    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let patterns: Vec<String> = text.split(',').map(str::to_owned).collect();
        let is_wrong = |pattern: &&String| {
            let rest = pattern.replacen('*', "", 1);
            pattern.is_empty() || !rest.chars().all(is_in_names)
        };
        match patterns.iter().find(is_wrong) {
            None => Ok(Self(patterns)),
            Some(wrong) => Err(format!(
                "maps: expected names of maps, with one * at most, separated by commas, found {wrong:?}"
            )),
        }
    }

    /// Whether one of the patterns fits the name.
    pub(super) fn contain(&self, map: &str) -> bool {
        self.0.iter().any(|pattern| match pattern.split_once('*') {
            None => pattern == map,
            Some((start, end)) => map.strip_prefix(start).is_some_and(|rest| rest.ends_with(end)),
        })
    }

    /// Whether every name fits.
    pub(super) fn are_all(&self) -> bool {
        self.0.iter().any(|pattern| pattern == "*")
    }

    pub(super) fn to_text(&self) -> String {
        self.0.join(",")
    }
}

/// Characters of the names of maps and callers.
fn is_in_names(c: char) -> bool {
    c.is_ascii_alphanumeric() || "._-".contains(c)
}

impl Entry {
    /// Reads a line.
    ///
    /// # Errors
    /// What was expected and what was found. It does not repeat the last field, which may be a
    /// token that somebody wrote in place of its hash.
    pub(super) fn parse(line: &str) -> Result<Self, String> {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let [name, scopes, maps, token] = fields[..] else {
            let found = fields.len();
            return Err(format!("expected NAME SCOPES MAPS HASH, found {found} fields"));
        };
        if name.len() > MAX_NAME_BYTES || !name.chars().all(is_in_names) {
            return Err(format!(
                "name: expected at most {MAX_NAME_BYTES} letters, digits, '.', '_' and '-', found {name:?}"
            ));
        }
        let token = match token {
            NO_TOKEN => None,
            hash => Some(TokenHash::parse(hash).ok_or_else(|| {
                format!(
                    "hash: expected \"sha256:\" and 64 hexadecimal digits, or {NO_TOKEN:?}; \
                     `lexsplat-server token` writes such a line"
                )
            })?),
        };
        Ok(Self {
            name: name.into(),
            scopes: scopes_of(scopes)?,
            maps: Maps::parse(maps)?,
            token,
            withdrawn: CancellationToken::new(),
        })
    }

    /// What [`Self::parse`] reads.
    pub(super) fn to_line(&self) -> String {
        let scopes: Vec<&str> = self.scopes.iter().map(|scope| scope.as_str()).collect();
        let token = self.token.map_or_else(|| NO_TOKEN.into(), TokenHash::to_text);
        format!("{} {} {} {token}", self.name, scopes.join(","), self.maps.to_text())
    }
}

fn scopes_of(text: &str) -> Result<Vec<Scope>, String> {
    let scopes: Result<Vec<Scope>, String> = text.split(',').map(str::parse).collect();
    scopes.map_err(|reason| format!("scopes: {reason}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_and_written() {
        let line = format!("robot-7 read,write kitchen*,hall {}", TokenHash::of("x").to_text());
        let entry = Entry::parse(&format!("  {} ", line.replace(' ', "\t "))).unwrap();
        assert_eq!(entry.to_line(), line);
        assert_eq!(entry.scopes, [Scope::Read, Scope::Write]);
        let entry = Entry::parse("robot-8 admin * certificate").unwrap();
        assert!(entry.token.is_none() && entry.maps.are_all());
    }

    #[test]
    fn wrong_lines_name_the_field_and_not_the_token() {
        let hash = TokenHash::of("x").to_text();
        for (line, expected) in [
            (format!("robot read * {hash} more"), "5 fields"),
            (format!("ro/bot read * {hash}"), "name:"),
            (format!("{} read * {hash}", "r".repeat(65)), "name:"),
            (format!("robot reed * {hash}"), "scopes: expected read, write or admin"),
            (format!("robot read, * {hash}"), "scopes:"),
            (format!("robot read a/b {hash}"), "maps:"),
            (format!("robot read a**b {hash}"), "maps:"),
            (format!("robot read a,, {hash}"), "maps:"),
            ("robot read * lexsplat_secret".into(), "hash:"),
        ] {
            let error = Entry::parse(&line).unwrap_err();
            assert!(error.contains(expected) && !error.contains("secret"), "{line}: {error}");
        }
    }

    #[test]
    fn patterns_fit_whole_names() {
        let maps = Maps::parse("kitchen*,hall,*-test,a*a").unwrap();
        for inside in ["kitchen", "kitchen2", "hall", "x-test", "-test", "aa", "aba"] {
            assert!(maps.contain(inside), "{inside}");
        }
        for outside in ["my-kitchen", "hall2", "Hall", "test", "a", "", "kitche"] {
            assert!(!maps.contain(outside), "{outside}");
        }
        assert!(!maps.are_all());
        assert!(Maps::every().contain("") && Maps::every().contain("x"));
    }
}

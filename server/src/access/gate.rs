//! The gate: finds out who is calling, and whether they may.

use super::caller::{AccessError, Caller};
use super::config::{AccessConfig, Public};
use super::credentials::Credentials;
use super::entries::{Entries, EntriesError};
use super::rules::Need;
use crate::file_watch::FileWatch;
use crate::telemetry::CALLS_REFUSED;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use tokio_util::sync::CancellationToken;

/// Knows all callers. Cheap to clone.
#[derive(Clone)]
pub(crate) struct Gate(Arc<Known>);

struct Known {
    config: AccessConfig,
    /// Until somebody follows the tokens file.
    watch: Mutex<Option<FileWatch>>,
    entries: RwLock<Arc<Entries>>,
}

impl Gate {
    /// Reads the callers.
    ///
    /// # Errors
    /// [`EntriesError`].
    pub(crate) fn new(config: AccessConfig) -> Result<Self, EntriesError> {
        let watch = Mutex::new(config.tokens.clone().map(|path| FileWatch::new(vec![path])));
        let entries = Entries::load(&config)?;
        if config.asks() {
            tracing::info!(callers = entries.count(), "callers are asked who they are");
        }
        let entries = RwLock::new(Arc::new(entries));
        Ok(Self(Arc::new(Known { config, watch, entries })))
    }

    /// Whether callers are asked who they are.
    pub(crate) fn asks(&self) -> bool {
        self.0.config.asks()
    }

    /// Reads the tokens file again whenever it changes, until `stopping` is cancelled. A file that
    /// cannot be read or has a malformed line changes nothing.
    pub(crate) async fn follow_file(self, stopping: CancellationToken) {
        let watch = self.0.watch.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(watch) = watch else { return };
        let reload = move || match Entries::load(&self.0.config) {
            Ok(entries) => {
                tracing::info!(callers = entries.count(), "the tokens file was read again");
                let mut known = self.0.entries.write().unwrap_or_else(PoisonError::into_inner);
                *known = Arc::new(entries.replacing(&known));
            }
            Err(error) => {
                tracing::error!(%error, "the tokens file changed and is not used: what was known stays");
            }
        };
        watch.follow(reload, stopping).await;
    }

    /// Lets a call in, or says why not. `map` is the map that its address names. `None`: everybody
    /// may make the call, and whoever made it is not known.
    ///
    /// # Errors
    /// [`AccessError`].
    pub(crate) fn admit(
        &self,
        need: Need,
        map: Option<&str>,
        credentials: Credentials<'_>,
    ) -> Result<Option<Caller>, AccessError> {
        let admitted = self.check(need, map, credentials);
        if let Err(error) = &admitted {
            let reason = if error.is_unknown() { "unknown" } else { "forbidden" };
            metrics::counter!(CALLS_REFUSED, "reason" => reason).increment(1);
        }
        admitted
    }

    fn check(
        &self,
        need: Need,
        map: Option<&str>,
        credentials: Credentials<'_>,
    ) -> Result<Option<Caller>, AccessError> {
        match need {
            Need::Nothing => return Ok(None),
            Need::Known(public) | Need::AllMaps(_, public) if self.is_public(public) => {
                // Who is known may see more than everybody.
                return Ok(self.identify(credentials).ok());
            }
            _ => {}
        }
        let caller = self.identify(credentials)?;
        match need {
            Need::Nothing | Need::Known(_) => {}
            Need::Scope(scope) => {
                caller.needs(scope)?;
                map.map_or(Ok(()), |map| caller.may_use(map))?;
            }
            Need::AllMaps(scope, _) => {
                caller.needs(scope)?;
                caller.may_use_all()?;
            }
        }
        Ok(Some(caller))
    }

    /// Who is calling.
    ///
    /// # Errors
    /// [`AccessError::NoToken`], [`AccessError::UnknownToken`].
    pub(crate) fn identify(&self, credentials: Credentials<'_>) -> Result<Caller, AccessError> {
        if !self.0.config.asks() {
            return Ok(Caller::anybody());
        }
        let entries = self.0.entries.read().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(token) = credentials.token {
            let entry = entries.with_token(token);
            return entry.map(Caller::of).ok_or(AccessError::UnknownToken);
        }
        let by_name = credentials.names.iter().find_map(|name| entries.named(name));
        by_name.map(Caller::of).ok_or(AccessError::NoToken)
    }

    fn is_public(&self, public: Public) -> bool {
        self.0.config.public.contains(&public)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::scope::Scope;
    use crate::access::token::TokenHash;

    fn gate(public: Vec<Public>) -> Gate {
        let line =
            |name: &str, rights: &str| format!("{name} {rights} {}", TokenHash::of(name).to_text());
        let entries = vec![line("reader", "read kitchen*"), line("owner", "read,admin *")];
        Gate::new(AccessConfig { entries, public, ..AccessConfig::default() }).unwrap()
    }

    fn with(token: &str) -> Credentials<'_> {
        Credentials { token: Some(token), names: &[] }
    }

    #[test]
    fn scope_and_map_are_needed() {
        let gate = gate(Vec::new());
        let read = Need::Scope(Scope::Read);
        let admitted = |need, map, who| gate.admit(need, map, who);
        let caller = admitted(read, Some("kitchen2"), with("reader")).unwrap().unwrap();
        assert_eq!(caller.name(), "reader");
        assert!(caller.sees("kitchen") && !caller.sees("hall"));
        let refused = |need, map, who| admitted(need, map, who).unwrap_err();
        let nobody = Credentials::default();
        assert_eq!(refused(read, Some("kitchen"), nobody), AccessError::NoToken);
        assert_eq!(refused(read, Some("kitchen"), with("other")), AccessError::UnknownToken);
        assert!(matches!(refused(read, Some("hall"), with("reader")), AccessError::Map { .. }));
        let delete = Need::Scope(Scope::Admin);
        let error = refused(delete, Some("kitchen"), with("reader"));
        assert!(matches!(error, AccessError::Scope { scope: Scope::Admin, .. }));
        assert!(admitted(delete, Some("hall"), with("owner")).is_ok());
        // Admin does not include write.
        let error = refused(Need::Scope(Scope::Write), None, with("owner"));
        assert!(matches!(error, AccessError::Scope { scope: Scope::Write, .. }));
    }

    #[test]
    fn a_certificate_makes_a_caller_known_and_a_wrong_token_is_not_overlooked() {
        let gate = gate(Vec::new());
        let names = ["stranger".to_owned(), "reader".to_owned()];
        let shown = Credentials { token: None, names: &names };
        assert_eq!(gate.identify(shown).unwrap().name(), "reader");
        let strangers = Credentials { token: None, names: &names[..1] };
        assert_eq!(gate.identify(strangers).unwrap_err(), AccessError::NoToken);
        let with_token = Credentials { token: Some("owner"), names: &names };
        assert_eq!(gate.identify(with_token).unwrap().name(), "owner");
        let wrong = Credentials { token: Some("other"), names: &names };
        assert_eq!(gate.identify(wrong).unwrap_err(), AccessError::UnknownToken);
    }

    #[test]
    fn what_is_public_is_open_and_the_rest_is_not() {
        let metrics = Need::AllMaps(Scope::Read, Public::Metrics);
        let health = Need::Known(Public::Healthz);
        let closed = gate(vec![Public::Readyz]);
        let nobody = Credentials::default();
        assert_eq!(closed.admit(health, None, nobody).unwrap_err(), AccessError::NoToken);
        assert!(closed.admit(health, None, with("reader")).is_ok());
        let error = closed.admit(metrics, None, with("reader")).unwrap_err();
        assert!(matches!(error, AccessError::SomeMaps { .. }));
        assert!(closed.admit(metrics, None, with("owner")).is_ok());
        let open = gate(vec![Public::Metrics, Public::Healthz]);
        assert!(open.admit(health, None, nobody).unwrap().is_none());
        let known = open.admit(health, None, with("reader")).unwrap().unwrap();
        assert_eq!(known.name(), "reader");
        assert!(open.admit(health, None, with("wrong")).unwrap().is_none());
        assert!(open.admit(metrics, None, nobody).is_ok());
        assert!(open.admit(Need::Nothing, None, with("wrong")).is_ok());
    }

    #[test]
    fn nobody_is_asked_without_entries() {
        let gate = Gate::new(AccessConfig::default()).unwrap();
        let caller = gate.admit(Need::Scope(Scope::Admin), Some("x"), Credentials::default());
        assert_eq!(caller.unwrap().unwrap().name(), "anybody");
    }
}

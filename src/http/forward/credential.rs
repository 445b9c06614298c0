//! Servers of a cluster authenticate each other with a shared secret that is never sent.

use data_encoding::HEXLOWER;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;

/// The cluster secret.
pub(super) struct Secret(Hmac<Sha256>);

impl Secret {
    pub(super) fn new(secret: &[u8]) -> Self {
        Self(Hmac::new_from_slice(secret).expect("a key of any length"))
    }

    fn mac(&self, from: i64, to: i64) -> Hmac<Sha256> {
        let mut mac = self.0.clone();
        mac.update(format!("swarmbench hop {from} {to}").as_bytes());
        mac
    }

    /// Proof of cluster membership. Whoever reads it can impersonate `from` towards `to`, as long as both incarnations live.
    pub(super) fn credential(&self, from: i64, to: i64) -> String {
        let mac = self.mac(from, to).finalize().into_bytes();
        format!("{from}.{to}.{}", HEXLOWER.encode(&mac))
    }

    /// Incarnation for which a server made this credential; `None` where the credential is invalid. The recipient may be an
    /// earlier server of this address.
    pub(super) fn recipient(&self, credential: &str) -> Option<i64> {
        let (from, rest) = credential.split_once('.')?;
        let (to, mac) = rest.split_once('.')?;
        let (from, to) = (from.parse().ok()?, to.parse().ok()?);
        let mac = HEXLOWER.decode(mac.as_bytes()).ok()?;
        self.mac(from, to).verify_slice(&mac).is_ok().then_some(to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_credential_is_for_one_server_and_of_the_same_secret() {
        let (own, other) = (Secret::new(b"a secret"), Secret::new(b"another"));
        let credential = own.credential(7, 8);
        assert_eq!(own.recipient(&credential), Some(8));
        assert_eq!(other.recipient(&credential), None);
        assert_eq!(own.recipient(&credential.replacen('7', "6", 1)), None);
        assert_eq!(own.recipient(&credential.replacen(".8.", ".9.", 1)), None);
        for bad in ["", ".", "7", "7.8", "7.8.", "7.8.zz", "7.x.00", "x.8.00"] {
            assert_eq!(own.recipient(bad), None, "{bad}");
        }
    }
}

//! How servers of a cluster know each other: by a secret that is never sent.

use data_encoding::HEXLOWER;
use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;

/// What all servers of a cluster know, and nobody else.
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

    /// By what a server shows another that it is one. Whoever reads it can pass for this server, towards that one, and no longer
    /// than both of them live.
    pub(super) fn credential(&self, from: i64, to: i64) -> String {
        let mac = self.mac(from, to).finalize().into_bytes();
        format!("{from}.{}", HEXLOWER.encode(&mac))
    }

    /// Whether it is the credential of a server for this one.
    pub(super) fn verifies(&self, credential: &str, me: i64) -> bool {
        let Some((from, mac)) = credential.split_once('.') else { return false };
        let (Ok(from), Ok(mac)) = (from.parse(), HEXLOWER.decode(mac.as_bytes())) else {
            return false;
        };
        self.mac(from, me).verify_slice(&mac).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_credential_is_for_one_server_and_of_the_same_secret() {
        let (own, other) = (Secret::new(b"a secret"), Secret::new(b"another"));
        let credential = own.credential(7, 8);
        assert!(own.verifies(&credential, 8));
        assert!(!own.verifies(&credential, 9));
        assert!(!other.verifies(&credential, 8));
        assert!(!own.verifies(&credential.replacen('7', "6", 1), 8));
        for bad in ["", ".", "7", "7.", "7.zz", "x.00"] {
            assert!(!own.verifies(bad, 8), "{bad}");
        }
    }
}

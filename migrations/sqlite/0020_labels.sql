-- An erasure replaces the label of the entrant's code, and labels in the audit log, which earlier versions left as they were.
UPDATE invitations SET label = (SELECT name FROM entries WHERE key = invitations.entry)
WHERE entry IN (SELECT key FROM entries WHERE erased_at IS NOT NULL);

UPDATE audit SET detail = coalesce(shown, '{}')
WHERE action IN ('competition.codes', 'competition.codes.revoke')
    AND competition IN (SELECT competition FROM entries WHERE erased_at IS NOT NULL);

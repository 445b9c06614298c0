-- Boards look for the few episodes that the host broke, without reading all of them.
CREATE INDEX episodes_voided ON episodes (key) WHERE voided_at IS NOT NULL;

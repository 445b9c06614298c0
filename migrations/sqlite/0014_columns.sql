-- What queries read out of JSON texts stands in columns, so that they need no JSON functions.

ALTER TABLE acts ADD COLUMN brief TEXT;                  -- a large record without its response and reasoning; else NULL
ALTER TABLE entries ADD COLUMN brief TEXT;               -- the declaration without its template and metadata; older rows: NULL

-- Rows of earlier versions have it, too. An opening that is damaged is reported when the episode is read.
UPDATE episodes
SET open_seats = CASE WHEN json_valid(opening) THEN json_extract(opening, '$.config.open_seats') IS NOT NULL ELSE 0 END
WHERE open_seats IS NULL;

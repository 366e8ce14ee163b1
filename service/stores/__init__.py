"""Where things are kept: records in Postgres, bytes in a folder or an S3 bucket."""

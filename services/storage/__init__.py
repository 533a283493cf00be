"""The fleet's own object storage, for a server that has no other: SeaweedFS, which speaks S3."""

"""What the verbs give: the base of all results, their JSON, their files, their pages."""

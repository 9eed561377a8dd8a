"""What runs srprov in other people's pipelines: the steps of action.yml and of templates/gitlab.yml."""
